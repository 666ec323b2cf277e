"""For which forcings is transport proved to be global, and for which a barrier to exist?

Cells of the (κ1, κ2) plane are proved whole, by a quadtree that is fine where the boundary runs;
`nasm/proofs/README.md` has the theorems. An open cell is one for which nothing is proved, which
says nothing.
"""

from workflows.shared.cli import choice, command, full_option, real, sweeps

_CELLS = ["32", "64", "128", "256", "512", "1024"]


@command()
@choice("--cells", _CELLS, "128", "Cells per unit of strength, at the finest.")
@real("--seconds", 0.5, 1e-3, 1e4, "CPU seconds to prove transport; then a cell is cut or left.")
@full_option("more than an hour of CPU time", cells="512")
@sweeps
def main(run, cells, seconds):
    """The proved map of 0 <= kappa2 <= kappa1 <= 1.125 and its images: two cubes, a figure in OUT.

    Needs the extra `proof`. The defaults take some eight minutes of CPU time.
    """
    import numpy as np

    from nasm.barriers import critical_scale
    from nasm.planes import two_kicks
    from nasm.proofs.barrier import need_flint
    from nasm.symmetries import ray
    from pipeline.cubes.barrier import last_barrier, unfolded
    from pipeline.cubes.proved_map import proved_map
    from workflows.figures.proved_map import draw_proved_map

    need_flint()
    angles = np.linspace(0, 45, 91)
    barriers = last_barrier(two_kicks(), angles, 1e-3)
    guess = [
        (angle, critical_scale(ray(angle), 0.1).value, "")
        for angle in np.linspace(0, 45, 4).tolist()
    ]
    with run.sweeping(barriers, later=[(proved_map(guess, int(cells), seconds), None)]):
        barrier = unfolded(run.sweep(barriers), angles)
        known = barrier.dropna("angle", subset=["critical_scale"])
        columns = (known[name].values.tolist() for name in ("angle", "critical_scale", "circle"))
        job = proved_map(list(zip(*columns, strict=True)), int(cells), seconds)
        run.check(job.cube)
        run.figure("proved_map", *draw_proved_map(run.sweep(job).load(), barrier))


if __name__ == "__main__":
    main()
