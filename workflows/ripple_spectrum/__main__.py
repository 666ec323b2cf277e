"""Which ripple frequencies lower the threshold most? The spectrum, from fast to slow ripples.

For kicks κ_n = κ(1 + d cos 2πnΩ), let κ_c be the strength κ at the last breakup, and κ_G its value
for constant kicks. The loss is 1 - κ_c/κ_G. To first order in d, small divisors predict it (see
`small_divisors`): it peaks where Ω is near mω mod 1. A slow ripple keeps the strengths near
κ(1 + d) for many kicks, so κ_c tends to κ_G/(1 + d) or less.

For Ω = p/q the last barrier is computed up to q = 64. For longer periods, such as those of
accelerator power supplies, only an upper bound on κ_c is known, from converse KAM or from an orbit
that escapes.

Writes two cubes, a table and a figure to OUT. The defaults take about a CPU minute; --quick
takes half a minute.
"""

from workflows.shared.cli import command, preset, real, several, sweeps, whole

SLOW = "1/200", "1/120", "1/80", "1/16"
DEPTHS = "0.1", "0.3"
MANY = "0.03", "0.1", "0.3", "0.6"


def parse_frequency(text):
    """Parse a frequency Ω = p/q from 1/1000 to 1/2, with q up to 1000, as a Fraction."""
    from nasm.checks import fraction
    from nasm.texts import short_repr

    number = fraction("frequency", text)
    if not 0 < number <= 0.5 or number.denominator > 1000:
        raise ValueError(
            f"{short_repr(text)} must be a frequency p/q from 1/1000 to 1/2, with q up to 1000"
        )
    return number


def parse_depth(text):
    """Parse the depth d of a modulation, from 10⁻³ to 1."""
    from nasm import checks
    from nasm.texts import parse_float

    return checks.real("depth", parse_float(text), 1e-3, 1)


@command()
@whole("--max-denominator", 8, 2, 64, "Largest q in the fractions p/q up to 1/2.")
@several("--frequency", SLOW, parse_frequency, "FRACTION", "Further Ω, in turns per kick.")
@several("--depth", DEPTHS, parse_depth, "DEPTH", "Depth d of the modulation, 0.001 to 1.")
@real("--tol", 1e-2, 1e-4, 0.1, "Relative width of the brackets, for up to 64 kicks a period.")
@whole(
    *("--n-predicted", 150, 2, 10**4),
    "Number of Ω with predictions only, in each of two series: equal steps, equal ratios.",
)
@preset("--quick", "A preview", max_denominator=4, frequency=("1/200",), depth=("0.3",))
@preset("--full", "In full, most of a CPU hour", max_denominator=14, depth=MANY)
@sweeps
def main(run, max_denominator, frequency, depth, tol, n_predicted):
    from pipeline.cubes.cube import untiled
    from pipeline.cubes.rotating_maps import ripples
    from workflows.figures.ripple_spectrum import draw_ripple_spectrum, ripple_spectrum_caption
    from workflows.ripple_spectrum import study
    from workflows.shared.fractions import up_to_half

    fractions = up_to_half(max_denominator, frequency.values())
    depths = [*depth.values()]
    job = ripples(fractions, depths, tol)
    names = [*map(str, fractions)]
    options = {"fractions": names, "depths": depths, "n_predicted": n_predicted}
    prediction = untiled("ripple_spectrum_predicted", **options)
    with run.sweeping(job, studies=[(prediction, 2 + 0.1 * n_predicted)]):
        swept = run.sweep(job).load()
        theory = run.kept(prediction, lambda: study.prediction(fractions, depths, n_predicted))
        cube = study.with_loss(swept, theory.attrs["golden"])
        run.table("ripple_spectrum", study.side_by_side(cube, theory))
        caption = ripple_spectrum_caption(cube, study.findings(cube, theory))
        run.figure("ripple_spectrum", draw_ripple_spectrum, cube, theory, caption=caption)
