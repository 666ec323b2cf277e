"""Where are the period-one orbits stable, and where do the secondary ones exist? Figs. 3 and 4.

Computes the residues of the primary points by exact formulas, and the secondary points near
(1/2, 0) by solving one equation numerically; also computes the error of the paper's cubic estimate
of the secondary points (arXiv:1606.04824, Sec. IV).

Writes two cubes and two figures to OUT in a few CPU seconds.
"""

from dataclasses import astuple

from workflows.shared.cli import axis, command, writes


@command()
@axis("--primary", "-4:4:400", "Range of both strengths for the primary points.")
@axis("--secondary", "0:8:200", "Range of both strengths for the secondary points.")
@writes
def main(run, primary, secondary):
    from pipeline.cubes.cube import untiled
    from workflows.figures import period_one as figures
    from workflows.shared.period_one import primary_dataset, secondary_dataset

    with run.driving():
        first = untiled("period_one_primary", axis=list(astuple(primary)))
        first = run.kept(first, lambda: primary_dataset(primary))
        second = untiled("period_one_secondary", axis=list(astuple(secondary)))
        second = run.kept(second, lambda: secondary_dataset(secondary))
        caption = figures.primary_caption(first)
        run.figure("period_one_primary", figures.draw_primary_points, first, caption=caption)
        caption = figures.secondary_caption(second)
        run.figure("period_one_secondary", figures.draw_secondary_points, second, caption=caption)
