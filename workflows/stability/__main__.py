"""Where does each method fail? Seven small studies, in three figures.

Four studies test the methods near the cusp at 45°, on both sides of the breakup, for irrational
rotation numbers close to fractions, and where a step (one period) is no longer a twist map although
each kick is one (converse KAM requires only the latter). Two others count the starts that the beam
search of converse KAM misses, and the wrong orbits that Newton's method converges to. The last
computes tori near a resonance. The captions state the results.

Writes seven cubes and three figures to OUT. The defaults take about four CPU minutes; --quick takes
one.
"""

from functools import partial

from workflows.shared.cli import command, flag, writes


@command()
@flag("--quick", "A preview: fewer and shorter runs of everything.")
@writes
def main(run, quick):
    from pipeline.cubes.cube import untiled
    from workflows.figures.stability import FIGURES, draw_stability, stability_caption
    from workflows.stability import study

    studies = {
        "cusp": study.near_cusp,
        "boundary": study.past_boundary,
        "fractions": study.disguised_fractions,
        "twist": study.beyond_the_twist,
        "beam": study.missed_survivors,
        "disorder": study.disordered_orbits,
        "tori": study.nearly_resonant,
    }
    plans = {name: untiled(f"stability_{name}", quick=quick) for name in studies}
    seconds = (40 if quick else 250) / len(studies)

    def compute(name):
        number = 1 + list(studies).index(name)
        run.line.show(f"study {number} of {len(studies)}, {name}")
        return studies[name](quick)

    with run.driving(*((plan, seconds) for plan in plans.values())):
        results = {name: run.kept(plans[name], partial(compute, name)) for name in studies}
        for name in FIGURES:
            caption = stability_caption(name, results)
            run.figure(name, draw_stability, name, results, caption=caption)
