"""Where does each method stop being right? Nine small studies of failure, in four figures.

1. Next to the cusp at 45°: who still answers, and are the errors honest? 2. On either side of the
breakup: who claims a circle, who denies it? 3. Fractions disguised as irrational, whose convergents
are the golden mean's. 4. Beyond the end of the twist, |κ2| = 2: single kicks keep theirs, which is
what converse KAM needs. 5. Amplitudes of circles, which Proposition 1 assumes to be below 1; a
circle not sampled may have a larger one. 6. Survivors that the search of converse KAM misses.
7. Fake circles of a naive Newton method, and the certificates. 8. Orbits of another order, from bad
starts. 9. Tori of pairs next to a resonance, and past their breakup.

The sentences that the command prints, with the numbers of the run, are kept as the caption.
"""

import click

from workflows.shared.cli import command, flag, writes


@command()
@flag("--quick", "A preview: fewer and shorter runs of everything.")
@writes
def main(run, quick):
    """Where each method stops being right: nine cubes and four figures in OUT.

    Two to three minutes on two cores; --quick less than one.
    """
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


if __name__ == "__main__":
    main()
