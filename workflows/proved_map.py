"""Map of the forcings for which a barrier, or global transport, is proved.

Transport is proved in cells of the (κ1, κ2) plane, by a quadtree that is refined along the
boundary; barriers are proved in triangles with a corner at κ = 0. `nasm/proofs/README.md` states
the theorems. In open cells neither is proved.

Three cubes and a figure in OUT, for 0 <= kappa2 <= kappa1 <= 1.125 and its mirror images. Needs the
extra `proof`. The defaults take about two CPU minutes.
"""

from workflows.shared.cli import choice, command, preset, real, sweeps

_CELLS = ["32", "64", "128", "256", "512", "1024", "2048", "4096"]
_SECONDS = (
    "CPU time limit per cell; a cell not proved in time is subdivided, or left open if finest."
)
_DISTANCE = "Relative distance from the boundary at which proofs of barriers stop."


@command()
@choice("--cells", _CELLS, "512", "Finest cells per unit of strength.")
@real("--cpu-seconds", 0.02, 1e-3, 1e4, _SECONDS)
@real("--distance", 0.09, 1e-3, 0.5, _DISTANCE)
@preset("--full", "In full, two CPU hours", cells="2048", cpu_seconds=0.2, distance=0.01)
@sweeps
def main(run, cells, cpu_seconds, distance):
    import numpy as np

    from nasm.barriers import critical_scale
    from nasm.planes import two_kicks
    from nasm.proofs.barrier import need_flint
    from nasm.symmetries import ray
    from pipeline.cubes.barrier import last_barrier, unfolded
    from pipeline.cubes.proved import proved_map, proved_triangles
    from workflows.figures.proved_map import draw_proved_map, proved_map_caption

    need_flint()
    angles = np.linspace(0, 45, 91)
    barriers = last_barrier(two_kicks(), angles, 1e-3)
    few = np.linspace(0, 45, 7).tolist()
    last = [critical_scale(ray(angle), 0.1) for angle in few]
    guess = [(angle, each.value) for angle, each in zip(few, last, strict=True)]
    then = (
        proved_map(guess, int(cells), cpu_seconds),
        proved_triangles(guess, [str(each.omega or "") for each in last], distance),
    )
    with run.sweeping(barriers, later=[(job, None) for job in then]):
        barrier = unfolded(run.sweep(barriers), angles)
        known = barrier.dropna("angle", subset=["critical_scale"])
        names = "angle", "critical_scale", "circle"
        at, scales, circles = (known[name].values.tolist() for name in names)
        rays = list(zip(at, scales, strict=True))
        jobs = proved_map(rays, int(cells), cpu_seconds), proved_triangles(rays, circles, distance)
        cubes = [run.sweep(job).load() for job in jobs]
        results = *cubes, barrier
        run.figure("proved_map", draw_proved_map, *results, caption=proved_map_caption(*results))
