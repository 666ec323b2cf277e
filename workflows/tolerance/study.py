"""The forcings of `tolerance`, the law that renormalisation predicts, and the findings."""

import numpy as np

from nasm import periodic
from workflows.shared.judgement import finding, span
from workflows.shared.tables import columns, dataset
from workflows.tolerance.response import DELTA, finer, golden, growth, modes, steps

PERIODS = range(2, 9)
# For each P, the sizes d of the two ripples that determine the measured exponent.
_RIPPLES = {2: (1e-2, 1e-3), 3: (3e-2, 1e-2), 4: (1e-2, 3e-3), 7: (3e-2, 1e-2)}


def ripple(period, shape="cosine"):
    """Return the ripple f of a period and shape, with mean 0 and rms 1."""
    n = np.arange(period)
    wave = np.cos(2 * np.pi * n / period)
    f = {"cosine": wave, "one kick": n == 0, "square": 2 * n < period}[shape]
    f = f - np.mean(f)
    return f / np.sqrt(np.mean(f**2))


def ripples(quick):
    """List the ripples of size d as (shape, d, profile), with the profile 1 + d·f.

    Cosines have d down to 10⁻⁵ for P = 2 and down to 0.003 for other P; if `quick`, there are fewer
    ripples. Other shapes have d = 0.1 and 0.01, and P = 4, 6 and 8.
    """
    sizes = np.array([1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5])
    sizes, periods = (sizes[:5:2], (2, 3)) if quick else (sizes, PERIODS)
    given = [(n, d) for n in periods for d in sizes if n == 2 or d >= 3e-3]
    other = [(n, d) for n, d in given if n in (4, 6, 8) and d in (0.1, 0.01)]
    shapes = {"cosine": given, "one kick": other, "square": other}
    return [(of, d, 1 + d * ripple(n, of)) for of, rows in shapes.items() for n, d in rows]


def forcings(n, climbs):
    """List n random forcings of 2 to 8 kicks, and the starts of hill climbs.

    The forcings are constant kicks plus Gaussian deviations of 10⁻³ to 10 times their strength; the
    starts are Gaussian.
    """
    random = np.random.default_rng(0)
    sizes = 10 ** random.uniform(-3, 1, n)
    given = [("random", d, 1 + d * random.standard_normal(2 + i % 7)) for i, d in enumerate(sizes)]
    normal = (np.random.default_rng([1, i]).standard_normal(2 + i % 7) for i in range(climbs))
    return given + [("climb", i, row) for i, row in enumerate(normal)]


def laws(cube):
    """Predict and measure the exponent of the loss caused by cosine ripples with P = 2 to 8.

    The loss is the fraction by which a ripple lowers the threshold.

    predicted : from the factor δ^h by which the loss grows in the h renormalisations of each mode
    in the cycle, and from the growth of the ripple, which is computed from the responses; its error
    is the change when longer orbits are used. measured : from the losses of the last circle under a
    ripple in the cube, and of the `finer` circle under the renormalised ripple; its error is due to
    the errors of the losses, plus the larger of two terms: the change from a larger ripple, and 2.5
    times the first loss over the growth of ln |response|.
    orbits : the shortest period of orbits that resolve the ripple obtained by renormalising a
    ripple of 1%.

    The corrections to this law are large. For P = 4 the law extrapolates from a ripple of 0.3% to a
    loss of 0.00173, whereas residues of the finer circle, with periods up to 46 000, yield 0.00301;
    that circle is certified at a loss of 0.0032. For this P the responses of minimax orbits grow by
    a factor of e^5.2 from period 8 to period 144, and of e^6.3 from period 2584 to 46 368.
    """
    rows = []
    for period in PERIODS:
        cycle = modes(period)
        *rates, turned = np.sum([growth(period, mode) for mode in cycle], axis=0)
        first, second = steps(period) * len(cycle) * np.log(DELTA) / rates
        smaller = (-1) ** turned * np.exp(-rates[0])
        orbits = periodic.cusp_period(golden() * (1 + smaller * 0.01 * ripple(period)))
        rows.append([first, abs(first - second), *_measured(cube, period, smaller), orbits])
    labels = {
        "predicted": "exponent of the loss that the responses predict",
        "predicted_error": "change of predicted when longer orbits are used",
        "measured": "exponent of the loss, by residues",
        "measured_error": "estimated error of measured",
        "orbits": "period of orbits that resolve the renormalised ripple if the ripple is 1%",
    }
    title, coords = "Exponents of the loss under a ripple", {"period": (PERIODS, "period P")}
    return dataset(title, coords, columns("period", labels, np.transpose(rows)))


def _measured(cube, period, smaller):
    """Return the exponent from the second of `_RIPPLES`, and its error.

    smaller : factor by which renormalisation rescales the ripple.
    """
    cosines = cube.isel(forcing=np.flatnonzero((cube.period == period) & (cube.family == "cosine")))
    circles = dict(zip(cosines.parameter.values, cosines.circle.values, strict=True))
    exponents, rate = [], -np.log(abs(smaller))
    for d in _RIPPLES.get(period, ()):
        if not circles.get(d):
            return np.nan, np.nan
        one, error = _loss(period, circles[d], d)
        two, other = _loss(period, finer(circles[d], period, 1)[0], smaller * d)
        exponents.append((np.log(one / two) / rate, (error / one + other / two) / rate, one))
    if not exponents:
        return np.nan, np.nan
    (before, *_), (exponent, error, loss) = exponents
    return exponent, error + max(abs(exponent - before), 2.5 * loss / rate)


def _loss(period, circle, d):
    """Return the loss that a cosine ripple causes for a circle, and its error."""
    profile = 1 + d * ripple(period)
    q_max = int(np.clip(10 * periodic.cusp_period(golden() * profile), 6000, 23_000))
    scale, unit = periodic.critical_scale(circle, profile, q_max), np.sqrt(np.mean(profile**2))
    return 1 - scale.value * unit / golden(), scale.error * unit / golden()


def findings(cube, laws, tried):
    """Describe the cost of a ripple and the test of the conjecture, with verdicts."""
    known = cube.loss_error < 0.2 * cube.loss
    percent = 100 * cube.loss[np.isclose(cube.parameter, 0.01)]
    is_two = percent.period == 2
    two, longer = percent.values[is_two], percent.values[~is_two]
    return " ".join([
        f"For {int(known.sum())} of {known.size} ripples the relative error of the loss is below "
        f"20%. A ripple of 1% lowers the threshold by {two.item():.2g}% if it alternates from kick "
        f"to kick, and by {span(longer)}% otherwise.",
        _law(laws),
        _conjecture(tried),
        "Forcings of more than 8 kicks, aperiodic forcings, ripples with P > 2 and d < 0.003, "
        "and other shapes were not tested.",
    ])  # fmt: skip


def _law(laws):
    table = laws.to_dataframe()
    error = table.measured_error + table.predicted_error
    sharp = error < 0.1 * table.predicted  # False where an error is unknown
    fits = bool((abs(table.measured - table.predicted) < error)[sharp].all())
    exponents = ", ".join(
        f"{row.measured:.3f} ± {row.measured_error:.1g} ({row.predicted:.3f} ± "
        f"{row.predicted_error:.1g}) for P = {row.Index}"
        for row in table.dropna(subset=["measured"]).itertuples()
    )
    vague = ", ".join(map(str, table.index[~sharp & table.measured.notnull()]))
    unsettled = f"For P = {vague} the errors, above 10%, are too large to decide. " if vague else ""
    others = table.orbits[table.measured.isnull()]
    long = ", ".join(f"{round(n, -3):.0f} for P = {period}" for period, n in others.items())
    text = (
        "between a ripple and the renormalised ripple the measured (predicted) exponents of the "
        f"loss are {exponents}; the error of a measured exponent includes the errors of the losses "
        "and the larger of two terms, one proportional to the loss and the other the change from a "
        "larger ripple; the error of a predicted exponent is the change from shorter orbits. "
        f"{unsettled}Other P were not tested: if a ripple of 1% is renormalised, only orbits of "
        f"about the following periods, or longer ones, resolve it: {long}"
    )
    claim = "for each P the loss scales with the power of the ripple that renormalisation predicts"
    return finding(claim, text, fits and sharp.all(), fits, bool(sharp.any()))


def _conjecture(tried):
    upper = tried.upper.values / golden()
    random, ends = (upper[tried.family == family] for family in ("random", "climb"))
    beaten = int(np.isinf(upper).sum())
    by_converse_kam = [(part > 1) & np.isfinite(part) for part in (random, ends)]
    text = (
        f"{beaten} of {random.size} random forcings of 2 to 8 kicks and {ends.size} hill climbs "
        "have a barrier at an rms strength of 1.001 κ_G, where κ_G is the threshold for constant "
        f"kicks. Orbits escape under {int((random <= 1).sum())} of the random forcings; converse "
        f"KAM excludes all circles under {by_converse_kam[0].sum()} others, and under the final "
        f"forcings of {by_converse_kam[1].sum()} climbs where no orbit escapes. Under the final "
        "forcings of the other climbs orbits escape, at rms strengths of "
        f"{ends[ends <= 1].max(initial=0):.2f} κ_G or less"
    )
    claim = "constant kicks keep a barrier up to the largest rms strength"
    return finding(claim, text, beaten == 0, known=ends.size > 0)
