"""What does the pipeline add to the tiles' own time, and how many workers can it feed?

Sweeps of synthetic tiles are measured, and with them the constants of the model of
`pipeline.throughput`: t_batch, t_tile, w_batch, w_tile from the CPU time of the driver and of the
workers, beside that of the tiles, in all sweeps; T_0, t_list from when the first tile begins;
t_store by workers that commit in a loop, all at once. The durations are checked by simulation: a
real scheduler and hundreds of workers, in one process, whose tiles sleep.
"""

import click

from workflows.cli import HELP, driver, finish, integers_option

COSTS = (0.001, 0.01, 0.1, 1.0)
TILES = (10, 100, 1000, 10_000)
SIMULATED_COSTS = (0.1, 1.0, 4.0)
ROUNDS = 3  # batches for each simulated worker
MOST_SIMULATED = 4000  # tiles
CROWD = (16, 64, 256)
PREDICTED = (1, 16, 64, 256, 1024)
MINUTES = 10  # of the sweep that the recommendations are for
GOOD = 0.9  # efficiency


def measure(client, scratch, n, cost, burn):
    """One sweep in the empty directory `scratch`: {quantity: seconds}."""
    import io
    import shutil
    import time

    from pipeline import store, synthetic
    from pipeline.sweep import sweep

    def cpu(workers):
        return sum(client.run(time.process_time, workers=workers).values())

    # Simulated workers are in one process, which any of them can tell the time of.
    everyone = list(client.scheduler_info(n_workers=-1)["workers"])
    everyone = everyone if burn else everyone[:1]
    shutil.rmtree(scratch, ignore_errors=True)
    cube = synthetic.cube(n, cost, burn)
    slow = 1.0 if burn else slowness()
    workers, here, start = cpu(everyone), time.process_time(), time.time()
    with store.driving(scratch):
        finish(sweep(client, scratch, cube, synthetic.tile, synthetic.cost, report=io.StringIO()))
        wall, driver_cpu = time.time() - start, time.process_time() - here
        workers = cpu(everyone) - workers
        found = store.read(scratch, cube.name)
        tiles, when = float(found.cpu_seconds.sum()), found.when.values
    shutil.rmtree(scratch)
    if burn:
        slow = float((when[:, 1] - when[:, 0]).sum()) / max(tiles, 1e-9)
    else:
        slow = (slow + slowness()) / 2
    return {
        "wall": wall,
        "first": float(when.min()) - start,
        "driver_cpu": driver_cpu,
        "workers_cpu": workers - tiles,
        "slowness": slow,
    }


def slowness():
    """Seconds that pass in a second of CPU time: 1 on an idle machine."""
    import time

    start, cpu = time.perf_counter(), time.thread_time()
    while time.thread_time() < cpu + 0.1:
        pass
    return (time.perf_counter() - start) / (time.thread_time() - cpu)


def commit_seconds(client, scratch, n=200):
    """Seconds that the store is held by one commit: CPU time of a commit when all workers commit
    at once, of which they wait for each other most, over the number of workers."""
    import shutil

    from pipeline import store, synthetic

    workers = list(client.scheduler_info(n_workers=-1)["workers"])
    cube = synthetic.cube(n * len(workers), 0, burn=False)
    with store.driving(scratch):
        layout = store.create(scratch, cube)
        futures = [
            client.submit(
                synthetic.commit_all,
                layout,
                range(i * n, (i + 1) * n),
                workers=[worker],
                pure=False,
            )
            for i, worker in enumerate(workers)
        ]
        seconds = sum(client.gather(futures)) / len(workers) ** 2
    shutil.rmtree(scratch)
    return seconds


def blank(title, coords, quantities):
    """A Dataset of NaN with the dims of `coords` and quantities {name: (meaning, units)}."""
    import numpy as np
    import xarray as xr

    shape = tuple(len(values) for values in coords.values())
    meanings = {
        "workers": ("workers", "1"),
        "cost": ("time of a tile", "s"),
        "tiles": ("tiles of the sweep", "1"),
    }
    dataset = xr.Dataset(
        {
            name: (tuple(coords), np.full(shape, np.nan), {"long_name": meaning, "units": units})
            for name, (meaning, units) in quantities.items()
        },
        {dim: np.asarray(values) for dim, values in coords.items()},
        {"title": title},
    )
    for dim in coords:
        dataset[dim].attrs = dict(zip(("long_name", "units"), meanings[dim], strict=True))
    return dataset


_QUANTITIES = {
    "wall": ("duration of the sweep", "s"),
    "first": ("from its start to the first tile's", "s"),
    "driver_cpu": ("CPU time of driver and scheduler", "s"),
    "workers_cpu": ("CPU time of the workers beside their tiles", "s"),
    "slowness": ("time that passed in a second of CPU time, by the machine's other load", "1"),
    "efficiency": ("part of the workers' time that went into the tiles", "1"),
    "model_wall": ("duration by the model, slowed as the machine was", "s"),
}


def plans(workers, crowd, quick):
    """The three datasets, nothing in them yet."""
    import numpy as np

    model = {
        "tiles": ("tiles of the sweep", "1"),
        "efficiency": ("part of the workers' time that goes into the tiles", "1"),
        "throughput": ("tiles per second", "1/s"),
    }
    tiles = TILES[:-1] if quick else TILES
    return (
        blank(
            "Sweeps of synthetic tiles that burn CPU time",
            {"workers": workers, "cost": COSTS, "tiles": list(tiles)},
            _QUANTITIES,
        ),
        blank(
            "Sweeps of synthetic tiles that sleep, with many workers in one process",
            {"workers": crowd, "cost": SIMULATED_COSTS[: 2 if quick else 3]},
            {"tiles": model["tiles"], **_QUANTITIES},
        ),
        blank(
            f"Model: sweeps of {MINUTES} minutes' work for each worker, each on its own core",
            {"workers": PREDICTED, "cost": np.geomspace(1e-3, 300, 221)},
            model,
        ),
    )


def run_measured(measured, scratch, longest, repeats):
    """Fill `measured`: sweeps up to `longest` seconds of tiles; medians of `repeats`, if short.

    Returns the seconds of a commit into the store, by the last number of workers.
    """
    import numpy as np

    from pipeline import synthetic
    from pipeline.cluster import connect

    for workers in measured.workers.values.tolist():
        click.echo(f"measuring {workers} worker processes", err=True)
        with connect(synthetic.no_warm_up, n_workers=workers) as client:
            measure(client, scratch, 10, 0.0, burn=True)  # imports
            commit = commit_seconds(client, scratch)
            for cost in measured.cost.values.tolist():
                for n in measured.tiles.values.tolist():
                    if n * cost > longest or n * cost < 0.05:
                        continue
                    runs = [
                        measure(client, scratch, n, cost, burn=True)
                        for _ in range(repeats if n * max(cost, 2e-3) <= 2.5 else 1)
                    ]
                    at = {"workers": workers, "cost": cost, "tiles": n}
                    for name in runs[0]:
                        measured[name].loc[at] = np.median([run[name] for run in runs])
    return commit


def run_simulated(simulated, scratch):
    """Fill `simulated`: three batches for each worker, or as many as are quickly simulated."""
    from pipeline import synthetic

    for workers in simulated.workers.values.tolist():
        click.echo(f"simulating {workers} workers", err=True)
        with synthetic.crowd(workers) as client:
            measure(client, scratch, workers, 0.0, burn=False)  # imports, connections
            for cost in simulated.cost.values.tolist():
                n = simulated_tiles(workers, cost)
                at = {"workers": workers, "cost": cost}
                simulated.tiles.loc[at] = n
                for name, value in measure(client, scratch, n, cost, burn=False).items():
                    simulated[name].loc[at] = value


def simulated_tiles(workers, cost):
    """How many tiles a simulated sweep has."""
    from pipeline import throughput

    return min(MOST_SIMULATED, int(ROUNDS * workers * throughput.packing(10**6, cost)[0]))


def compare(dataset, constants, crowded):
    """Fill in `efficiency`, and `model_wall` with all that computes slowed as the machine was.

    crowded : the tiles sleep, with many workers in one process; the machine does not slow them.
    """
    from pipeline import throughput

    sweeps = dataset.tiles.where(dataset.wall > 0), dataset.cost, dataset.workers
    took = dataset.cost if crowded else dataset.cost * dataset.slowness
    for name, values in (
        ("model_wall", throughput.sweep_seconds(*sweeps, constants, crowded, dataset.slowness)),
        ("efficiency", throughput.efficiency(sweeps[0], took, dataset.workers, dataset.wall)),
    ):
        dataset[name][:] = values.transpose(*dataset[name].dims)


def predict(model, constants):
    """Fill `model`: sweeps that would take `MINUTES` at full efficiency.

    Tiles are not quite equal: one that takes as long as a batch comes last.
    """
    import numpy as np

    from pipeline import throughput

    tiles = np.maximum(1, np.rint(60 * MINUTES * model.workers / model.cost))
    last = model.cost * throughput.packing(tiles, model.cost)[0]
    seconds = throughput.sweep_seconds(tiles, model.cost, model.workers, constants, longest=last)
    model["tiles"][:] = tiles
    model["efficiency"][:] = throughput.efficiency(tiles, model.cost, model.workers, seconds)
    model["throughput"][:] = tiles / seconds


def good_costs(model, workers):
    """(least, largest) seconds of a tile between which the efficiency is `GOOD` throughout, around
    its best; NaN if it is not good anywhere."""
    import numpy as np

    row = model.efficiency.sel(workers=workers).values
    best = int(row.argmax())
    if row[best] < GOOD:
        return np.nan, np.nan
    poor = np.flatnonzero(row < GOOD)
    first = max(poor[poor < best], default=-1) + 1
    last = min(poor[poor > best], default=row.size) - 1
    return float(model.cost[first]), float(model.cost[last])


@click.command(context_settings=HELP)
@click.option("--out", default="out", show_default=True, help="Directory of the results.")
@integers_option("--workers", "1,2", 64, "Worker processes of the measured sweeps.")
@integers_option("--crowd", None, 512, "Workers simulated.  [default: 16,64,256]")
@click.option("--quick", is_flag=True, help="A preview: short sweeps, and 16 and 64 workers.")
def main(out, workers, crowd, quick):
    """Throughput and overhead of the pipeline: three cubes, two tables and a figure in OUT.

    About six minutes on two busy cores, a quick run one. Measured on synthetic tiles, in a scratch
    directory in OUT that is deleted; other cubes are not touched.
    """
    crowd = crowd or (CROWD[:2] if quick else CROWD)
    with driver(out):
        import dataclasses
        import shutil

        from pipeline import store, throughput
        from pipeline.schema import Cube
        from workflows.figures.scaling import draw_scaling
        from workflows.figures.style import save

        names = ("scaling_measured", "scaling_simulated", "scaling_model")
        datasets = plans(workers, crowd, quick)
        for name, dataset in zip(names, datasets, strict=True):
            store.refuse_different(out, Cube(name, dataset, {}, {"quick": quick}))
        measured, simulated, model = datasets
        scratch = f"{out}/scaling_scratch"
        shutil.rmtree(scratch, ignore_errors=True)  # of a run that was killed
        try:
            commit = run_measured(measured, scratch, *((1.0, 1) if quick else (10.0, 3)))
            run_simulated(simulated, scratch)
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
        constants = throughput.fit(measured, simulated, commit)
        compare(measured, constants, crowded=False)
        compare(simulated, constants, crowded=True)
        predict(model, constants)
        for name, dataset in zip(names, datasets, strict=True):
            dataset.attrs |= {f"seconds_{key}": value for key, value in vars(constants).items()}
            store.replace(out, Cube(name, dataset, {}, {"quick": quick}))
            if dataset is not model:
                table = dataset.to_dataframe().dropna(subset="wall")
                table.to_csv(f"{out}/{name}.csv", float_format="%.4g")
        figures = save(draw_scaling(*datasets), out, "scaling")
    for field in dataclasses.fields(constants):
        click.echo(f"{field.name:13} {1e3 * getattr(constants, field.name):8.3f} ms")
    for name, dataset in zip(names[:2], datasets, strict=False):
        ratio = (dataset.wall / dataset.model_wall).values
        ratio = ratio[ratio > 0]
        click.echo(f"{name}: {ratio.min():.2f} to {ratio.max():.2f} times as long as by the model")
    for count in PREDICTED[1:]:
        least, largest = good_costs(model, count)
        click.echo(
            f"{count:5} workers, {MINUTES} minutes: {100 * GOOD:.0f}% efficiency with tiles of "
            f"{least:.2g} to {largest:.2g} s"
        )
    click.echo(f"cubes:  {out}/cubes.zarr, groups {', '.join(names)}")
    click.echo(f"tables: {out}/{names[0]}.csv, {out}/{names[1]}.csv")
    click.echo(f"figure: {', '.join(figures)}")


if __name__ == "__main__":
    main()
