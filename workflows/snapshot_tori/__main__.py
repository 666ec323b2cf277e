"""When does a torus break as the kicks grow, judged by graphs, mean distances and exponents?

Ensembles start on tori of the map with κ = 0.5: on the golden circle, on other circles around
the cylinder, and in islands. In the ramps κ_n = 0.5 + r·n they become snapshot tori (Jánosi & Tél,
Chaos 29 (2019) 121105). For growth rates r from 10⁻² to 10⁻⁴ per kick, this command compares

- the numbers of kicks after which converse KAM excludes all graphs, and all graphs through a point
  of a torus;
- the kick at which the ensemble-averaged pairwise distance (EAPD) of a torus exceeds that of any
  graph, and the onset of its growth, after which distances stay ten times larger than on any graph;
- the finite-time Lyapunov exponents of individual orbits, which may contradict such averages
  (Grime & Morrison, arXiv:2505.04750), and the fraction of orbits that have separated at the onset.

`nasm.snapshot` defines these quantities, and derives the bound on the EAPD of a graph. This bound
requires twist, which this map has; the maps of arXiv:2501.08147 and arXiv:2505.04750 are nontwist.

Writes a cube and a figure to OUT. The defaults take half a CPU minute; --quick takes ten seconds.
"""

from workflows.shared.cli import command, flag, writes


@command()
@flag("--quick", "A preview: growth rates down to 1e-3 per kick, not 1e-4; fewer tori.")
@writes
def main(run, quick):
    import numpy as np

    from pipeline.cubes.cube import untiled
    from workflows.figures.snapshot_tori import draw_snapshot_tori, snapshot_tori_caption
    from workflows.snapshot_tori import study

    rates = 10 ** -np.arange(2, 3.01 if quick else 4.01, 0.25)
    settings = study.Settings(n_starts=8, n_points=128) if quick else study.Settings()
    cube = untiled("snapshot_tori", quick=quick)
    with run.driving((cube, 3 if quick else 20)):
        cube = run.kept(cube, lambda: study.snapshots(rates, 1e-3, settings))
        caption = snapshot_tori_caption(cube, study.findings(cube))
        run.figure("snapshot_tori", draw_snapshot_tori, cube, caption=caption)
