"""Where does each method stop being right? Seven small studies of failure, in three figures.

Next to the cusp at 45°, on either side of the breakup, at fractions disguised as irrational, beyond
the end of the twist (single kicks keep theirs, which is what converse KAM needs), in the searches
of converse KAM and of Newton's method, and for tori next to a resonance. What they found is
printed, and is the caption.

Seven cubes and three figures in OUT. Two to three minutes on two cores; --quick less than one.
"""

import click

from workflows.shared.cli import command, flag, writes


@command()
@flag("--quick", "A preview: fewer and shorter runs of everything.")
@writes
def main(run, quick):
    from workflows.figures.stability import draw_stability
    from workflows.stability import limits, searches, tori

    studies = {
        "cusp": limits.near_cusp,
        "boundary": limits.past_boundary,
        "fractions": limits.disguised_fractions,
        "twist": limits.beyond_the_twist,
        "beam": searches.missed_survivors,
        "disorder": searches.disordered_orbits,
        "tori": tori.nearly_resonant,
    }
    found = {}
    with run.driving(40 if quick else 250):
        for number, (name, study) in enumerate(studies.items(), 1):
            click.echo(f"study {number} of {len(studies)}: {name}", err=True)
            found[name] = run.keep(f"stability_{name}", study(quick), quick=quick)
        for name, drawn in draw_stability(found).items():
            run.figure(name, *drawn)
