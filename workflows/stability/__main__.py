"""Where does each method stop being right? Nine small studies of failure, in three figures.

What they found, in the full run:

1. Distance to the cusp. Residues answer down to 10⁻³ degrees from 45°, barriers to 3·10⁻⁴, and
   then say that they do not; converse KAM and continuation answer down to 10⁻⁵, with errors of 10⁻⁴
   and 4·10⁻³ of the value. Errors stayed within what was claimed, but for continuation at 10° and
   3°, which was off by 1.2 times its claim of 8·10⁻⁷.
2. Past the breakup s_c. No circle of 16384 points is certified beyond it, and the last one is 0.1%
   to 0.2% below. Converse KAM with 5000 steps eliminates from 2·10⁻⁴ beyond on (10⁻⁴ at 45°), and
   nothing below. Weighted Birkhoff averages of 5000 steps see a "regular" orbit, with five digits
   or more, up to 0.5% beyond on every ray. 100 orbits in 10⁵ steps show an escape nowhere but 10%
   beyond at 45°.
3. Fractions disguised as irrational, [0;1,…,1,a,(1)]: for a = 10 and q ≤ 13 they break at 1.60 to
   1.96, where both methods reach that far. Behind a larger a residues used to answer with the
   breakup of the golden circle, 2.0806, as the convergents before a are its own, with errors of
   10⁻² to 10⁻¹⁰; continuation too, with 2.065 ± 0.025 or so. Now residues give no answer until
   their periods know a, and continuation none until its circles know the tail behind it: for
   a = 10 and q ≤ 21 it has a value, for a = 100 and 10⁶ none at any q up to 1597.
4. The end of the twist, |κ2| = 2, is far outside: converse KAM, which works with single kicks and
   needs no twist of the whole step, eliminates all starts within two steps before it. No circle is
   certified beyond. Orbits of 89/144 are lost from scales of 1.25 (0°) to 2.25 (135°) on; before,
   their residues reach 10⁸³. Weighted Birkhoff averages show 16 digits there, and no circle: many
   of the longest-lived starts are regular orbits of another kind.
5. Amplitudes. The last circles' are 0.077 on the axis to 0.155 on the diagonal, the same before
   both kicks; those of seven other circles inside at most 0.1625. Proposition 1 asks for less than
   1: it has sixfold room everywhere in the plane up to CB_gt, and |Δy| > 1.17 would do as an exit.
   (On these samples: a circle not sampled may have a larger one.)
6. The beam search of converse KAM misses the longest life by 1% or more in 65%, 21% and 3% of 150
   searches with 1, 2 and 4 starts kept, and in none with 8 to 32. It uses 32.
7. Fake circles. With a stop on small updates Newton's method goes on 66% past the breakup with 16
   points, 10% with 64, 1.9% with 256, 0.3% with 1024; with 512 its steps end short of it. All 181
   fakes are rejected by both certificates.
8. Orbits of another order. From starts off by 0.03 and 0.1 turns Newton's method ends on another
   one in no trial up to the scale 0.8, and in 12% to 40% from 1.0 on. All of these the order check
   refused: none of 16 000 trials gave a wrong orbit.
9. Rounding. Orbits drift off a circle like √n: 10⁻¹³ after 10⁷ steps with either sine, 5·10⁻¹³ on
   a lattice, which alone is exactly reversible; 10⁶ steps and back are 10⁻⁷ off otherwise. float32
   is 2·10⁻⁶ off from 10⁵ steps on. On the lift x keeps fewer and fewer digits, and the drift grows
   like n^1.5: 3·10⁻⁹ after 10⁶ steps, and as many back are 2% of a turn off.
"""

import click

from workflows.parts.cli import command, writes


@command()
@click.option("--quick", is_flag=True, help="A preview: fewer and shorter runs of everything.")
@writes
def main(run, quick):
    """Where each method stops being right: nine cubes and three figures in OUT.

    Two to three minutes on two cores; --quick less than one.
    """
    from workflows.figures.stability import draw_stability
    from workflows.stability.studies import STUDIES

    found = {}
    with run.driving():
        for name, study in STUDIES.items():
            found[name] = run.keep(f"stability_{name}", study(quick), quick=quick)
            click.echo(f"{name}: {found[name].attrs['title']}", err=True)
        for name, figure in draw_stability(found).items():
            run.figure(name, figure)


if __name__ == "__main__":
    main()
