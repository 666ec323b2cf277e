"""The main job: where in the (κ1, κ2) plane does global transport begin, and what breaks there?

Three methods in one store and one picture (arXiv:1606.04824, Secs. V and VI): first escape times
over the plane by direct iteration, which close in on the boundary from outside like N^(-1/3); the
boundaries CB_ω of the paper's six circles by continuation; and CB_gt itself on rays, bracketed
between a certified circle and converse KAM, with the circle that is the last to break.
"""

import click

from workflows.cli import HELP, angles_option, carry_out, cluster_options, session, store_option
from workflows.escape_plane import escape_plane, plane_options, planned
from workflows.labelled import write_table
from workflows.last_barrier import ray_angles, tips_option, unfolded


def boundary_table(dataset, angles, steps):
    """The boundary of the largest ensemble along rays: a Dataset with dims (n, angle).

    critical_scale is the distance from the origin, resolution the cell's width there.
    """
    import numpy as np
    import xarray as xr

    from nasm.escape import boundary
    from nasm.symmetries import ray

    field = dataset.escape_time.isel(ensemble=-1)
    axes = dataset.kappa1.values, dataset.kappa2.values
    scale = xr.DataArray(
        [boundary(field.values, *axes, angles, n) for n in steps],
        {"n": steps, "angle": angles},
        ("n", "angle"),
    )
    kappa1, kappa2 = (scale * xr.DataArray(part, dims="angle") for part in ray(angles).T)
    table = xr.Dataset({"kappa1": kappa1, "kappa2": kappa2, "critical_scale": scale})
    cell = max(np.ptp(axis[:2]) for axis in axes)
    if "level" in dataset:
        level = dataset.level
        there = table[["kappa1", "kappa2"]].fillna(0)  # NaN has no nearest cell
        here = level.sel(kappa1=there.kappa1, kappa2=there.kappa2, method="nearest")
        cell = cell * 2.0 ** (level.max() - here.drop_vars(["kappa1", "kappa2"]))
    table["resolution"] = cell + 0 * scale
    return table


@click.command(context_settings=HELP)
@plane_options("-1.1:1.1:512", "0:1.1:256", n_max=100_000, n_orbits=64, tile=8, levels=4)
@angles_option(181)
@tips_option
@click.option(
    "--tol",
    default=1e-4,
    show_default=True,
    type=click.FloatRange(1e-5, 0.1),
    help="Width of the bracket of CB_gt, and error of the CB_omega, to aim at.",
)
@store_option
@cluster_options
def main(out, place, cluster, plane, angles, tips, tol):
    """The critical boundary of global transport: three cubes, three tables and a figure in OUT.

    The defaults take about two minutes on two cores. The paper's size of direct iteration is
    --n-max 1000000 --n-orbits 10000.
    """
    from nasm.numbers import NAMES, parse
    from pipeline.cubes import breakdown
    from pipeline.cubes.barrier import last_barrier

    rays = ray_angles(angles, tips)
    circle_job = breakdown.by_continuation(sorted(map(parse, NAMES), key=float), rays, tol)
    last_job = last_barrier(rays, tol)
    jobs = [planned(plane), circle_job, last_job]
    with session(out, cluster, jobs, place) as client:
        barrier = unfolded(carry_out(client, place, last_job), rays)
        circles = carry_out(client, place, circle_job)
        dataset = escape_plane(client, place, plane)
        from workflows.figures.critical_boundary import draw_critical_boundary
        from workflows.figures.style import save

        direct = boundary_table(dataset, rays, plane.drawn)
        for n in direct.n.values[direct.critical_scale.isnull().all("angle")]:
            click.echo(f"no ray passes into transport within {n} steps in this plane", err=True)
        write_table(barrier, f"{out}/critical_boundary.csv")
        write_table(circles, f"{out}/circle_boundaries.csv")
        direct.to_dataframe().to_csv(f"{out}/direct_boundary.csv", float_format="%.6g")
        figures = save(draw_critical_boundary(dataset, circles, barrier), out, "critical_boundary")
    click.echo(f"cubes:  {place}/cubes.zarr, groups escape, breakdown and barrier")
    click.echo(f"tables: {out}/critical_boundary.csv, circle_boundaries.csv, direct_boundary.csv")
    click.echo(f"figure: {', '.join(figures)}")


if __name__ == "__main__":
    main()
