"""Where does each method stop being right? Seven small studies of failure, in three figures.

Next to the cusp at 45°, on either side of the breakup, at fractions disguised as irrational, beyond
the end of the twist (single kicks keep theirs, which is what converse KAM needs), in the searches
of converse KAM and of Newton's method, and for tori next to a resonance. What they found is
printed, and is the caption.

Seven cubes and three figures in OUT. Two to three minutes on two cores; --quick less than one.
"""

from workflows.shared.cli import command, flag, writes


@command()
@flag("--quick", "A preview: fewer and shorter runs of everything.")
@writes
def main(run, quick):
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
    found = {}
    with run.driving(40 if quick else 250):
        for number, (name, compute) in enumerate(studies.items(), 1):
            run.line.show(f"study {number} of {len(studies)}, {name}")
            found[name] = run.keep(f"stability_{name}", compute(quick), quick=quick)
        for name in FIGURES:
            run.figure(name, draw_stability, name, found, caption=stability_caption(name, found))
