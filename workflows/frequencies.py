"""How does the last barrier of a rotating map depend on its frequency Ω?

On a ray of the (κ̄, Δκ) plane (arXiv:1606.04824, Sec. VII), this command computes the scale at
which the last circle breaks, for fractions Ω = p/q and several phases φ0. For irrational Ω, it
computes the scale at which the last torus breaks. Ω and -Ω are equivalent. The results show whether
the smallest scale over the phases, for convergents of an irrational Ω, tends to the scale at Ω.

The default irrational numbers are [0;8,(1)], [0;5,(1)], … [0;2,(1)], [0;2,3,(1)], √5 - 2, √2 - 1,
1 - 1/√2, π - 3, 1/e and 1 - 1/τ - 1/τ², where τ is the tribonacci constant.

Writes a cube, a table and a figure to OUT. The defaults take about 13 CPU minutes;
--quick takes about two.
"""

from fractions import Fraction

from workflows.shared.cli import command, preset, real, several, sweeps, whole

IRRATIONAL = (
    *("0.11603574565909282", "0.14159265358979312", "0.16071324478583876", "0.1779982111184266"),
    *("0.21654236465910046", "0.2360679774997898", "0.276393202250021", "0.2928932188134524"),
    *("0.36787944117144233", "0.38196601125010515", "0.41421356237309515", "0.43929141899193214"),
)
ALSO = "3/19", "7/17", "8/21"


def parse_frequency(text):
    """Return a Fraction p/q with q ≤ 64, or a float that is not too close to such a fraction."""
    from nasm.checks import fraction
    from nasm.texts import parse_float, short_repr

    number = fraction("frequency", text) if "/" in text else parse_float(text)
    if not 0 < number <= 0.5:
        raise ValueError(
            f"{short_repr(text)} must be a frequency above 0, at most 1/2, like 8/21 "
            "or 0.41421356237"
        )
    near = Fraction(number).limit_denominator(64)
    if "/" in text and number != near:
        raise ValueError(f"{short_repr(text)} must have a denominator up to 64, like {near}")
    if "/" not in text and abs(number - near) < 1e-8:
        raise ValueError(
            f"{short_repr(text)} is too close to the fraction {near}; give the fraction itself"
        )
    return number


@command()
@whole(
    "--max-denominator",
    8,
    2,
    64,
    "Largest q of the fractions p/q; 34 takes about a CPU hour with --tol 0.01.",
)
@several(
    *(
        "--frequency",
        ALSO + IRRATIONAL,
        parse_frequency,
        "OMEGA",
        "Additional values of Ω, either fractions or irrational numbers.",
    ),
    shown=f"{', '.join(ALSO)} and the irrational numbers above",
)
@whole("--n-phases", 3, 2, 1000, "Number of phases from 0 to 1/(2q) for each fraction p/q.")
@real("--tol", 1e-3, 1e-4, 0.1, "Relative width of the brackets, for rational Ω.")
@real("--angle", 45.0, 0, 180, "Angle of the ray (κ̄, Δκ) = s·(cos, sin), in degrees.")
@preset("--quick", "A preview", max_denominator=5, frequency=IRRATIONAL[-2:-1])
@sweeps
def main(run, max_denominator, frequency, n_phases, tol, angle):
    from pipeline.cubes import rotating_maps
    from workflows.figures.frequencies import draw_frequencies, frequencies_caption
    from workflows.shared.fractions import up_to_half

    given = up_to_half(max_denominator, frequency.values())
    fractions = [number for number in given if isinstance(number, Fraction)]
    irrational = [number for number in given if isinstance(number, float)]
    job = rotating_maps.last_barriers(fractions, n_phases, irrational, [angle], tol)
    with run.sweeping(job):
        cube = run.sweep(job).load()
        run.table("frequencies", cube)
        drawn = cube.isel(angle=0)
        run.figure("frequencies", draw_frequencies, drawn, caption=frequencies_caption(drawn))
