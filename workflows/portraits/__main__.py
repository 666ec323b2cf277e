"""What do the orbits look like? Phase portraits of T_{κ1κ2}, Figs. 1 and 2.

Fig. 1: T_{κ1κ2}, T_{κ2κ1} and the nonautonomous map itself (arXiv:1606.04824, Eq. (1)). An orbit of
the nonautonomous map is an orbit of T_{κ1κ2} after even numbers of kicks, and an orbit of T_{κ2κ1}
after odd numbers. Fig. 2: four forcings related by the symmetries of Sec. III, each iterated
independently.

Writes two cubes and two figures to OUT in a few CPU seconds.
"""

from workflows.shared.cli import command, whole, writes


@command()
@whole("--n-orbits", 48, 2, 1000, "Orbits per portrait; they start on x = 0 and on x = 1/2.")
@whole("--n-max", 1000, 1, 100_000, "Number of steps of T, and of kicks of the nonautonomous map.")
@writes
def main(run, n_orbits, n_max):
    from pipeline.cubes.cube import untiled
    from workflows.figures import portraits as figures
    from workflows.portraits.study import nonautonomous_dataset, symmetric_dataset

    size = {"n_orbits": n_orbits, "n_max": n_max}
    with run.driving():
        kicks = run.kept(untiled("portraits", **size), lambda: nonautonomous_dataset(**size))
        symmetric = untiled("portraits_symmetry", **size)
        symmetric = run.kept(symmetric, lambda: symmetric_dataset(**size))
        run.figure("portraits", figures.draw_kicks, kicks, caption=figures.kicks_caption(kicks))
        caption = figures.symmetry_caption(symmetric)
        run.figure("portraits_symmetry", figures.draw_symmetry, symmetric, caption=caption)
