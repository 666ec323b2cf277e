"""Studies of stability: at the cusp, past the breakup, at fractions, without twist, in amplitude.

Their findings are in `workflows.stability.__main__`.
"""

import numpy as np
import xarray as xr

from nasm import barriers, circles, escape, orbits, periodic
from nasm.circles import continuation
from nasm.converse_kam import symmetry_line
from nasm.critical import Status
from nasm.maps import twist
from nasm.numbers import RotationNumber, convergents, parse
from nasm.symmetries import dominant_centre, ray
from pipeline.cubes.cube import status_code
from workflows.shared.tables import ANGLE, described, listed, outcomes

_LIFE = described("steps in which converse KAM eliminates all; inf: not so")
_DIGITS = described("digits of the weighted Birkhoff average of the longest-lived")
_ESCAPE = described("first escape of 100 orbits, steps; inf: none")


def near_cusp(quick):
    """1. Compare values and errors next to the cusp at 45° with longer runs.

    `periodic` and `circles.continuation` on the circle of γ, `converse_kam.symmetry_line` and
    `barriers` on the last circle: by residues of ten times longer orbits, and where these fail, by
    lives a hundred times longer.
    """
    gamma, deltas = parse("gamma"), np.geomspace(10, 1e-5, 5 if quick else 13)
    q_max = 15_000 if quick else 60_000
    rows = []
    for delta in deltas:
        profile = ray(45 - delta)
        circle = periodic.critical_scale(gamma, profile, q_max)
        last = barriers.critical_scale(profile, 3e-4 if quick else 1e-4)
        if last.status is Status.OK:
            last = periodic.critical_scale(last.omega, profile, q_max)
        if last.status is not Status.OK:
            last = symmetry_line.critical_scale(profile, 30_000 if quick else 100_000)
        found = [
            (periodic.critical_scale(gamma, profile), circle),
            (continuation.critical_scale(gamma, profile), circle),
            (symmetry_line.critical_scale(profile, 1000), last),
            (barriers.critical_scale(profile, 1e-3), last),
        ]
        rows.append([_judged(scale, judge) for scale, judge in found])
    off, claimed, uncertain, status = np.array(rows).transpose(2, 1, 0)
    dims = "approach", "delta"
    return xr.Dataset(
        {
            "off": (dims, off, described("difference to the sharpest value known, in parts of it")),
            "error": (dims, claimed, described("error that the method claims, relative")),
            "judge_error": (dims, uncertain, described("error that the sharpest method claims")),
            "status": outcomes(dims, status),
        },
        {
            "approach": listed("approach", "periodic", "continuation", "cones", "barriers"),
            "delta": ("delta", deltas, described("distance 45° - φ from the cusp", "degree")),
        },
        {"title": "Distance to the cusp at 45 degrees"},
    )


def _judged(scale, judge):
    off = abs(scale.value - judge.value) / judge.value
    status = status_code(scale.status)
    return off, scale.error / scale.value, judge.error / judge.value, status


def past_boundary(quick):
    """2. Ask each method at scales s_c(1 + x), on either side of the breakup s_c."""
    angles = (20.0, 45.0) if quick else (0.0, 20.0, 40.0, 45.0)
    decades = np.geomspace(1e-4, 1e-1, 4 if quick else 10)
    excess = np.concatenate([-decades[::-1], [0.0], decades])
    n_cones, n_escape, n_modes = 5000, *((10_000, 2048) if quick else (100_000, 16_384))
    efforts = {"n_cones": n_cones, "n_escape": n_escape, "n_modes": n_modes}
    starts = escape.ensemble(100)
    shape = len(angles), excess.size
    certified, digits, lived, escaped = np.zeros((4, *shape))
    for i, angle in enumerate(angles):
        best = barriers.critical_scale(ray(angle), 1e-3)
        for j, x in enumerate(excess):
            kappa = best.value * (1 + x) * ray(angle)
            circle = circles.invariant_circle(best.omega, kappa, n_max=n_modes)
            certified[i, j] = circle.certified
            y, lived[i, j] = symmetry_line.longest_lived(kappa, n_cones)
            site, a = dominant_centre(kappa)
            digits[i, j] = orbits.rotation_number(np.roll(kappa, -site), a, y, 5000)[1]
            escaped[i, j] = escape.first_escape(kappa, *starts, [100], n_escape)[0]
    dims = "angle", "excess"
    said = described("whether a circle of n_modes points is certified")
    return xr.Dataset(
        {
            "certified": (dims, certified.astype("int8"), said),
            "elimination_time": (dims, lived, _LIFE),
            "digits": (dims, digits, _DIGITS),
            "escape_time": (dims, escaped, _ESCAPE),
        },
        {
            "angle": ("angle", list(angles), ANGLE),
            "excess": ("excess", excess, described("scale over that of the breakup, less 1")),
        },
        {"title": "Distance past the breakup", **efforts},
    )


def disguised_fractions(quick):
    """3. Break circles of fractions disguised as irrational, [0;1,…,1,a,(1)], on (0.3, 0.2).

    They are 1/(aq²) from p/q and, for large a, break long before the golden circle, to which their
    first convergents belong. Judged by residues of longer orbits where these see the tail.
    """
    kappa, large = np.array([0.3, 0.2]), (10, 100, 10**6)
    ones = range(3, 10 if quick else 17)
    q = [list(convergents(RotationNumber((0, *[1] * n))))[-1].denominator for n in ones]
    values, errors = np.full((2, len(large), 3, len(ones)), np.nan)
    lower, status = np.full((len(large), len(ones)), np.nan), np.zeros((len(large), 3, len(ones)))
    for i, a in enumerate(large):
        for j, n in enumerate(ones):
            omega = RotationNumber((0, *[1] * n, a), (1,))
            found = (
                periodic.critical_scale(omega, kappa),
                continuation.critical_scale(omega, kappa),
                periodic.critical_scale(omega, kappa, 10_000 if quick else 20_000),
            )
            values[i, :, j] = [scale.value for scale in found]
            errors[i, :, j] = [scale.error for scale in found]
            lower[i, j] = found[1].lower
            circle = circles.invariant_circle(omega, kappa)
            codes = found[0].status, found[1].status, circle.status
            status[i, :, j] = [status_code(code) for code in codes]
    dims = "quotient", "approach", "q"
    golden = periodic.critical_scale(RotationNumber((0,), (1,)), kappa).value
    last = described("last certified circle of continuation")
    approaches = "periodic", "continuation", "longer orbits; of status: circles"
    return xr.Dataset(
        {
            "value": (dims, values, described("breakup, in parts of (0.3, 0.2)")),
            "error": (dims, errors, described("error that the method claims for value")),
            "lower": (("quotient", "q"), lower, last),
            "status": outcomes(dims, status),
        },
        {
            "quotient": ("quotient", list(large), described("partial quotient a after the ones")),
            "approach": listed("approach", *approaches),
            "q": ("q", q, described("denominator of the fraction")),
        },
        {"title": "Fractions disguised as irrational rotation numbers", "golden": float(golden)},
    )


def beyond_the_twist(quick):
    """4. Try the methods for scales up to 3; the twist ends at |κ2| = 2."""
    angles, scales = (0.0, 20.0, 45.0, 90.0, 135.0), np.linspace(0.25, 3.0, 12 if quick else 23)
    shape = len(angles), scales.size
    least, lived, residue, digits, escaped, status = np.full((6, *shape), np.nan)
    x = np.arange(400) / 400
    for i, angle in enumerate(angles):
        for j, scale in enumerate(scales):
            kappa = scale * ray(angle)
            least[i, j] = twist(kappa, *np.meshgrid(x, x)).min()
            y, lived[i, j] = symmetry_line.longest_lived(kappa, 2000)
            residue[i, j] = periodic.residue(kappa, 89, 144)
            site, a = dominant_centre(kappa)
            digits[i, j] = orbits.rotation_number(np.roll(kappa, -site), a, y, 2000)[1]
            escaped[i, j] = escape.first_escape(kappa, *escape.ensemble(100), [100], 2000)[0]
            status[i, j] = status_code(circles.invariant_circle(parse("gamma"), kappa, 512).status)
    dims = "angle", "scale"
    minimax = described("residue of the minimax orbit of 89/144; NaN: not found")
    return xr.Dataset(
        {
            "twist": (dims, least, described("least ∂x'/∂y of a step")),
            "elimination_time": (dims, lived, _LIFE),
            "residue": (dims, residue, minimax),
            "digits": (dims, digits, _DIGITS),
            "escape_time": (dims, escaped, _ESCAPE),
            "circle": outcomes(dims, status),
        },
        {
            "angle": ("angle", list(angles), ANGLE),
            "scale": ("scale", scales, described("scale s of the forcing")),
        },
        {"title": "Near the end of the twist and beyond"},
    )
