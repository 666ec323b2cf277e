"""Where does each method stop being right? Seven small studies of failure, in three figures.

Next to the cusp at 45°, on either side of the breakup, at fractions disguised as irrational, beyond
the end of the twist (single kicks keep theirs, which is what converse KAM needs), in the searches
of converse KAM and of Newton's method, and for tori next to a resonance. `findings` lists the
studies; what they found is printed, and is the caption.

Seven cubes and three figures in OUT. Two to three minutes on two cores; --quick less than one.
"""

import click

from workflows.shared.cli import command, flag, writes


@command()
@flag("--quick", "A preview: fewer and shorter runs of everything.")
@writes
def main(run, quick):
    from workflows.figures.stability import draw_stability
    from workflows.stability.findings import STUDIES

    found, said = {}, {}
    with run.driving(40 if quick else 250):
        for number, (name, (study, say)) in enumerate(STUDIES.items(), 1):
            click.echo(f"study {number} of {len(STUDIES)}: {name}", err=True)
            found[name] = run.keep(f"stability_{name}", study(quick), quick=quick)
            said[name] = f"{number}. {say(found[name])}"
        for name, (studies, figure) in draw_stability(found).items():
            run.figure(name, figure, "\n".join(said[study] for study in studies))
