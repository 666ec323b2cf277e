"""How does the last barrier of a rotating map depend on its frequency Ω?

On a ray of (κ̄, Δκ) (arXiv:1606.04824, Sec. VII) the scale at which the last circle breaks, for
fractions Ω = p/q and several phases φ0, or the last torus, for irrational Ω; -Ω is as Ω. Is the
scale of an irrational Ω the limit of the least one, over the phases, of its convergents?

The default irrational numbers are [0;8,(1)], [0;5,(1)], … [0;2,(1)], [0;2,3,(1)], √5 - 2, √2 - 1,
1 - 1/√2, π - 3, 1/e and 1 - 1/τ - 1/τ², τ the tribonacci constant.

A cube, a table and a figure in OUT. The defaults take some twelve CPU minutes; --quick less than
one.
"""

from fractions import Fraction

from workflows.shared.cli import command, preset, real, several, sweeps, whole

IRRATIONAL = (
    *("0.11603574565909282", "0.14159265358979312", "0.16071324478583876", "0.1779982111184266"),
    *("0.21654236465910046", "0.2360679774997898", "0.276393202250021", "0.2928932188134524"),
    *("0.36787944117144233", "0.38196601125010515", "0.41421356237309515", "0.43929141899193214"),
)
ALSO = "4/25", "12/29", "8/21", "13/34"


def parse_irrational(text):
    """Return a float from 0 to 1/2 that is not near a fraction p/q with q ≤ 64."""
    number = float(text)
    near = Fraction(number).limit_denominator(64) if 0 < number < 0.5 else Fraction(number)
    if abs(near - number) < 1e-8:
        raise ValueError(
            f"{number} must be between 0 and 1/2, and not next to a fraction like {near}; "
            "fractions go to --also"
        )
    return number


def parse_fraction(text):
    """Return a Fraction from 1/64 to 1/2 with a denominator up to 64."""
    from nasm.checks import fraction

    number = fraction("also", text)
    if not 0 < number <= Fraction(1, 2) or number.denominator > 64:
        raise ValueError(f"{text!r} must be a fraction from 1/64 to 1/2, like 8/21")
    return number


@command()
@whole("--q-max", 10, 2, 64, "Fractions p/q with q up to this one; 34 takes one to two CPU hours.")
@several("--also", ALSO, parse_fraction, "P/Q", "Further fractions.")
@several("--irrational", IRRATIONAL, parse_irrational, "OMEGA", "Frequencies from 0 to 1/2.")
@whole("--phases", 8, 2, 1000, "Phases from 0 to 1/2q of each fraction.")
@real("--angle", 45.0, 0, 180, "Ray (κ̄, Δκ) = s·(cos, sin), in degrees.")
@preset("--quick", "A preview", q_max=5, also=(), phases=3, irrational=IRRATIONAL[-2:-1])
@sweeps
def main(run, q_max, also, irrational, phases, angle):
    from pipeline.cubes import rotating_maps
    from workflows.figures.frequencies import draw_frequencies

    inner = {Fraction(p, q) for q in range(2, q_max + 1) for p in range(1, q // 2 + 1)}
    fractions, irrational = sorted(inner.union(also.values())), list(irrational.values())
    job = rotating_maps.last_barriers(fractions, phases, irrational, [angle])
    with run.sweeping(job):
        cube = run.sweep(job).load()
        run.table("frequencies", cube)
        run.figure("frequencies", *draw_frequencies(cube.isel(angle=0)))
