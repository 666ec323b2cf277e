"""For which forcings is transport proved to be global? The proved map of the (κ1, κ2) plane.

Cells are proved whole, by a quadtree that is fine where the boundary runs; `nasm/PROOFS.md` has the
theorem. An open cell is one for which nothing is proved, which says nothing.
"""

import click

from workflows.parts.cli import command, real, sweeps


@command()
@click.option(
    "--cells",
    type=click.Choice(["32", "64", "128", "256", "512", "1024"]),
    default="512",
    show_default=True,
    help="Finest cells for each unit of the strengths.",
)
@real("--seconds", 0.5, 1e-3, 1e4, "CPU time after which a cell is cut, or left open.")
@sweeps
def main(run, cells, seconds):
    """The proved map: a cube and a figure in OUT, of 0 <= kappa2 <= kappa1 <= 1.125 and its images.

    The defaults take some 20 minutes on two cores, --cells 128 two.
    """
    import numpy as np

    from nasm.planes import two_kicks
    from pipeline.cubes.barrier import last_barrier, unfolded
    from pipeline.cubes.proved_map import transport_proved
    from workflows.figures.proved_map import draw_proved_map

    angles = np.linspace(0, 45, 91)
    barriers = last_barrier(two_kicks(), angles, 1e-3)
    with run.sweeping(barriers, sweeps=2):
        barrier = unfolded(run.sweep(barriers), angles)
        scales = barrier.critical_scale.to_series().dropna().to_dict()
        job = transport_proved(scales, int(cells), seconds)
        run.check(job.cube)
        run.figure("proved_map", *draw_proved_map(run.sweep(job).load(), barrier))


if __name__ == "__main__":
    main()
