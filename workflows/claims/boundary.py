"""Claims on transport barriers in the known limits and by direct computation (Sec. V)."""

import numpy as np

from nasm import barriers, escape, periodic
from nasm.maps import kick, step
from nasm.numbers import moebius, parse
from nasm.symmetries import ray
from nasm.verdict import verdict
from workflows.claims.map import largest
from workflows.claims.rules import CLAIMS, Claim, agrees, graded, identity, printed, rounding
from workflows.parts.amplitudes import amplitudes
from workflows.parts.direct import exponent
from workflows.parts.rays import with_tie

KAPPA_G = printed("0.971635406")
_LIMITS = "python -m pytest tests/test_barriers.py::"
_DISGUISES = f"{_LIMITS}test_the_last_circle_of_the_standard_map_in_all_its_disguises"

# Angle of the ray, κ at the breakup in units of κ_G, and the ω of the critical circles.
_KNOWN = [
    ("Sec. V.A.1", "(κ, 0)", 0.0, 0.5, ("gamma", "1-gamma", "2-gamma", "gamma+1")),
    ("Sec. V.A.2", "(0, κ)", 90.0, 0.5, ("gamma", "1-gamma", "2-gamma", "gamma+1")),
    ("Sec. V.A.3", "(κ, κ)", 45.0, 1.0, ("2gamma", "2-2gamma")),
    ("Sec. V.A.3", "(-κ, κ)", 135.0, 1.0, ("2gamma-1", "3-2gamma")),
]
_MIRRORED = (10.0, 20.0, 30.0, 40.0)
_INSETS = [(0.526, 0.69), (0.526, 0.73), (-0.69, 0.525), (-0.73, 0.525)]


def boundary_claims(bias, n_max, n_orbits):
    """Judge Sec. V; `bias` is that of direct iteration at 45°, from `direct.direct_bias`."""
    return [
        _standard_map(),
        *_reductions(),
        *(claim for known in _KNOWN for claim in _critical_circles(*known)),
        _amplitudes(),
        *_square(n_max, n_orbits),
        *_exponents(bias),
        *_insets(n_orbits),
    ]


def _standard_map():
    gamma, mirrored = (periodic.critical_scale(parse(n), (1.0,)) for n in ("gamma", "1-gamma"))
    error = gamma.error + mirrored.error + abs(gamma.value - mirrored.value)
    return Claim(
        "Sec. III.A",
        "In the standard map the circles of γ and 1 - γ both break at κ_G = 0.971635406",
        *agrees(gamma.value, error, *KAPPA_G),
        "python -m pytest tests/test_periodic.py::test_kappa_g_to_twelve_digits",
    )


def _reductions():
    def first(kappa, x, y):
        x_after, y_after = step((kappa[0], 0), x, y)
        return np.subtract((x_after, 2 * y_after), kick(2 * kappa[0], x, 2 * y))

    def second(kappa, x, y):
        x_after, y_after = step((0, kappa[1]), x, y)
        return np.subtract((x_after + y_after, 2 * y_after), kick(2 * kappa[1], x + y, 2 * y))

    def third(kappa, x, y):
        return np.subtract(step(kappa[[0, 0]], x, y), kick(kappa[0], *kick(kappa[0], x, y)))

    one = "python -m pytest tests/test_maps.py::"
    single = f"{one}test_one_kick_alone_is_the_standard_map_at_twice_the_strength"
    return [
        Claim(
            "Sec. V.A.1, Eq. (mapk1v1_old)",
            "With X = x, Y = 2y, T_κ0 is the standard map at 2κ",
            *identity(largest(first), rounding(2)),
            single,
        ),
        Claim(
            "Sec. V.A.2, Eq. (mapk2v1_old)",
            "With X = x + y, Y = 2y, T_0κ is the standard map at 2κ",
            *identity(largest(second), rounding(2)),
            single,
        ),
        Claim(
            "Sec. V.A.3",
            "T_κκ is the standard map iterated twice",
            *identity(largest(third), rounding(2)),
            f"{one}test_equal_kicks_are_the_standard_map_twice",
        ),
    ]


def _critical_circles(place, forcing, angle, part, names):
    last = barriers.critical_scale(ray(angle), 1e-4)
    size = np.abs(ray(angle)).max()
    value, rounded = (part * number for number in KAPPA_G)
    omegas = [parse(name) for name in names]
    scales = [periodic.critical_scale(omega, ray(angle)) for omega in omegas]
    apart = max(abs(scale.value - last.value) / (scale.error + last.error) for scale in scales)
    named = last.omega in [_standard(omega) for omega in omegas]
    near = max(np.finfo(float).eps, *(abs(scale.value / last.value - 1) for scale in scales))
    text = (
        f"they break within {near:.0e} of CB_gt, in parts of it; the last circle found there is "
        f"{with_tie(str(last.omega), angle)}"
    )
    return [
        Claim(
            place,
            f"For {forcing} the critical circle breaks at κ = {'κ_G' if part == 1 else 'κ_G/2'}",
            *agrees(last.value * size, last.error * size, value, rounded),
            _DISGUISES,
        ),
        Claim(
            place,
            f"For {forcing} the critical circles have ω = {', '.join(names)}".replace("gamma", "γ"),
            *graded(text, named and apart <= 1, known=np.isfinite(apart)),
            _DISGUISES,
        ),
    ]


def _standard(omega):
    """Return the one in [0, 1] of ω, -ω and ω + 2, which stand for one another."""
    omega = moebius(omega, 1, -2 * round(float(omega) / 2))
    return omega if float(omega) > 0 else moebius(omega, -1, 0)


def _amplitudes():
    found = amplitudes(quick=True)
    most = float(max(found["last"].max(), found.largest.max()))
    return Claim(
        "Sec. V.B, Proposition 1",
        "For |κ_i| < 1 all circles have an amplitude below 1, so that |y_n - y₀| > 2 shows "
        "transport",
        *graded(f"largest amplitude {most:.3f}, of circles on rays up to CB_gt", most < 1),
        "python -m workflows.stability",
        "Eight circles at each of six fractions of six rays, a sample. Beyond CB_gt there are no "
        "circles, and CB_gt lies in |κ_i| < 1.",
    )


def _square(n_max, n_orbits):
    direct = {}
    for angle in (a for phi in _MIRRORED for a in (phi, 90 - phi, 90 + phi, 180 - phi)):
        found = escape.critical_scale(ray(angle), max(n_max // 10, 1000), min(n_orbits, 100))
        direct[angle] = found.upper
    exact = {angle: barriers.critical_scale(ray(angle), 1e-3) for angle in direct}
    pairs = [(a, 90 - a) for a in _MIRRORED] + [(180 - a, 90 + a) for a in _MIRRORED]
    apart = max(abs(direct[a] / direct[b] - 1) for a, b in pairs)
    excess = min(direct[angle] / exact[angle].value - 1 for angle in direct)
    sided = [(a, b) for a in _MIRRORED for b in (90 - a, 90 + a, 180 - a)]
    off = max(abs(exact[a].value - exact[b].value) for a, b in sided)
    allowed = max(exact[a].error + exact[b].error for a, b in sided)
    return [
        Claim(
            "Sec. V.B, Fig. 6",
            "By direct iteration CB_gt is symmetric about κ2 = κ1 and κ2 = -κ1 up to machine "
            "precision",
            *graded(
                f"mirror images of {len(pairs)} points differ by up to {apart:.1e}, in parts of "
                f"them; all are at least {excess:.1e} beyond CB_gt",
                apart < 1e-14,
                apart < excess,
            ),
            CLAIMS,
            "The boundary itself is symmetric, see below; at finite N the starts in 0 ≤ y ≤ 0.3 "
            "are not, and an escape time is a draw.",
        ),
        Claim(
            "Sec. V.B",
            "CB_gt has the symmetries of the square: κ1 ↔ κ2, κ1 → -κ1, κ2 → -κ2",
            *identity(off, allowed, f"{len(exact)} rays computed apart: largest difference"),
            f"{_LIMITS}test_the_eight_rays_of_the_square_have_one_barrier",
        ),
    ]


def _exponents(bias):
    n, off = bias.n.values, bias.values
    windows = [(n >= first) & (n <= 30 * first) for first in n[n <= n[-1] / 30]]
    windows = [window for window in windows if np.isfinite(off[window]).sum() > 4]
    known = len(windows) > 0
    eta, error = exponent(n, off) if known else (np.nan, np.nan)
    found = [exponent(n[window], off[window])[0] for window in windows] or [np.nan]
    lowest, highest = min(found), max(found)
    text = (
        f"η = {eta:.2f} ± {error:.2f} for N = {n[0]} to {n[-1]}; {lowest:.2f} to {highest:.2f} "
        "where N grows 30-fold within that"
    )
    claims = [
        Claim(
            "Sec. V.B, Fig. 7",
            f"Direct iteration on (κ, κ): {words}",
            *graded(text, abs(eta - number) <= 2 * error, lowest <= number <= highest, known),
            "python -m workflows.convergence",
            "Holds if within two standard errors of the fit; with a caveat if some part of the "
            "range, over which N grows 30-fold, has it. The paper does not say which N it fitted.",
        )
        for number, words in (
            (2.681, "κ_N - κ_G ~ N^(-1/η) with η = 2.681"),
            (3.322, "η = 3.322 for large N"),
        )
    ]
    theory = 3.012
    near = max(abs(number - theory) for number in (2.681, 3.322))
    return [
        *claims,
        Claim(
            "Sec. V.B, Fig. 7",
            f"η is close to {theory}, of transport in the standard map",
            *graded(text, abs(eta - theory) <= near, known=known),
            "python -m workflows.convergence",
            f"Close: as the paper's own values are, to {near:.2g}.",
        ),
    ]


def _insets(n_orbits):
    """Judge "close" by the loosest boundary of the figure, that of N = 10⁵."""
    n_max = 100_000
    claims = []
    for point in _INSETS:
        found = verdict(point)
        excess = 1 / found.boundary.value - 1
        direct = escape.critical_scale(point, n_max, n_orbits)
        width = direct.upper / found.boundary.value - 1
        text = (
            f"{found.answer.value}: {abs(excess):.2%} {'beyond' if excess > 0 else 'inside'} CB_gt "
            f"on its ray, where direct iteration up to N = {n_max} ends {width:.2%} beyond"
        )
        claims.append(
            Claim(
                "Sec. V.B, Fig. 6",
                f"({point[0]}, {point[1]}) is close to the computed boundary",
                *graded(text, abs(excess) <= width, known=np.isfinite(excess + width)),
                f"python -m workflows.ask {point[0]} {point[1]}",
                "Close: no further from CB_gt than the loosest of the paper's boundaries, N = 10⁵.",
            )
        )
    return claims
