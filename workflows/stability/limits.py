"""Studies of stability: at the cusp, past the breakup, at fractions, without twist."""

import numpy as np

from nasm import barriers, circles, escape, orbits, periodic
from nasm.circles import continuation
from nasm.converse_kam import symmetry_line
from nasm.critical import Status
from nasm.maps import twist
from nasm.numbers import RotationNumber, convergents, parse
from nasm.symmetries import dominant_centre, ray
from pipeline.cubes.cube import fields, status_code
from workflows.shared.tables import ANGLE, dataset, described, listed, outcomes

_NUMBERS = {"value": "value", "error": "error", "lower": "lower"}  # of a CriticalScale
_LIVES = {
    "elimination_time": "steps in which converse KAM eliminates all; inf: not so",
    "digits": "digits of the weighted Birkhoff average of the longest-lived",
    "escape_time": "first escape of 100 orbits, steps; inf: none",
}


def near_cusp(quick):
    """1. Compare values and errors next to the cusp at 45° with longer runs.

    `periodic` and `circles.continuation` on the circle of γ, `converse_kam.symmetry_line` and
    `barriers` on the last circle: by residues of ten times longer orbits, and where these fail, by
    lives a hundred times longer.
    """
    gamma, deltas = parse("gamma"), np.geomspace(10, 1e-5, 5 if quick else 13)
    q_max = 15_000 if quick else 60_000

    def found_and_judges(profile):
        circle = periodic.critical_scale(gamma, profile, q_max)
        last = barriers.critical_scale(profile, 3e-4 if quick else 1e-4)
        if last.status is Status.OK:
            last = periodic.critical_scale(last.omega, profile, q_max)
        if last.status is not Status.OK:
            last = symmetry_line.critical_scale(profile, 30_000 if quick else 100_000)
        return [
            (periodic.critical_scale(gamma, profile), circle),
            (continuation.critical_scale(gamma, profile), circle),
            (symmetry_line.critical_scale(profile, 1000), last),
            (barriers.critical_scale(profile, 1e-3), last),
        ]

    scales = fields([found_and_judges(ray(45 - delta)) for delta in deltas], _NUMBERS)
    value, error = scales["value"].T, scales["error"].T  # dims (found or judge, approach, delta)
    (claimed, uncertain), dims = error / value, ("approach", "delta")
    off = abs(value[0] - value[1]) / value[1]
    approaches = "Greene's residue", "continuation of circles", "converse KAM", "all together"
    distance = deltas, described("distance 45° - φ from the cusp", "degree")
    variables = {
        "off": (dims, off, "difference to the sharpest value known, in parts of it"),
        "error": (dims, claimed, "error that the method claims, relative"),
        "judge_error": (dims, uncertain, "error that the sharpest method claims"),
        "status": outcomes(dims, scales["status"].T[0]),
    }
    title = "Distance to the cusp at 45 degrees"
    coords = {"approach": listed("approach", *approaches), "delta": distance}
    return dataset(title, coords, variables)


def past_boundary(quick):
    """2. Ask each method at scales s_c(1 + x), on either side of the breakup s_c."""
    angles = (20.0, 45.0) if quick else (0.0, 20.0, 40.0, 45.0)
    decades = np.geomspace(1e-4, 1e-1, 4 if quick else 10)
    excess = np.concatenate([-decades[::-1], [0.0], decades])
    n_cones, n_escape, n_modes = 5000, *((10_000, 2048) if quick else (100_000, 16_384))
    breakups = {angle: barriers.critical_scale(ray(angle), 1e-3) for angle in angles}

    def answers(angle, x):
        kappa = breakups[angle].value * (1 + x) * ray(angle)
        circle = circles.invariant_circle(breakups[angle].omega, kappa, n_max=n_modes)
        single = _first_escape(kappa, n_escape, "single")
        return circle.certified, single, *_lives(kappa, n_cones, 5000, n_escape)

    certified, single, *lives = _over(angles, excess, answers)
    words, dims = "whether a circle of n_modes points is certified", ("angle", "excess")
    variables = {
        "certified": (dims, certified.astype("int8"), words),
        "escape_time_single": (dims, single, f"{_LIVES['escape_time']}, in single precision"),
        **_labelled_lives(dims, lives),
    }
    efforts = {"n_cones": n_cones, "n_escape": n_escape, "n_modes": n_modes}
    beyond = excess, "scale over that of the breakup, less 1"
    coords = {"angle": (list(angles), ANGLE), "excess": beyond}
    return dataset("Distance past the breakup", coords, variables, efforts)


def disguised_fractions(quick):
    """3. Break circles of fractions disguised as irrational, [0;1,…,1,a,(1)], on (0.3, 0.2).

    They are 1/(aq²) from p/q and, for large a, break long before the golden circle, to which their
    first convergents belong. Judged by residues of longer orbits where these see the tail.
    """
    kappa, large = np.array([0.3, 0.2]), (10, 100, 10**6)
    ones = range(3, 10 if quick else 17)
    q = [list(convergents(RotationNumber((0, *[1] * n))))[-1].denominator for n in ones]
    omegas = [[RotationNumber((0, *[1] * n, a), (1,)) for n in ones] for a in large]

    def found(omega):
        residues = periodic.critical_scale(omega, kappa)
        longer = periodic.critical_scale(omega, kappa, 10_000 if quick else 20_000)
        return residues, continuation.critical_scale(omega, kappa), longer

    scales = fields([[found(omega) for omega in row] for row in omegas], _NUMBERS)
    value, error, lower, status = (scales[name].swapaxes(1, 2) for name in (*_NUMBERS, "status"))
    certified = [[circles.invariant_circle(omega, kappa) for omega in row] for row in omegas]
    status[:, 2] = fields(certified, {})["status"]
    golden = periodic.critical_scale(RotationNumber((0,), (1,)), kappa).value
    approaches = "periodic", "continuation", "longer orbits; of status: circles"
    coords = {
        "quotient": (list(large), "partial quotient a after the ones"),
        "approach": listed("approach", *approaches),
        "q": (q, "denominator of the fraction"),
    }
    variables = {
        "value": ([*coords], value, "breakup, in parts of (0.3, 0.2)"),
        "error": ([*coords], error, "error that the method claims for value"),
        "lower": (("quotient", "q"), lower[:, 1], "last certified circle of continuation"),
        "status": outcomes([*coords], status),
    }
    title = "Fractions disguised as irrational rotation numbers"
    return dataset(title, coords, variables, {"golden": float(golden)})


def beyond_the_twist(quick):
    """4. Try the methods for scales up to 3; the twist ends at |κ2| = 2."""
    angles, scales = (0.0, 20.0, 45.0, 90.0, 135.0), np.linspace(0.25, 3.0, 12 if quick else 23)
    x = np.arange(400) / 400

    def answers(angle, scale):
        kappa = scale * ray(angle)
        circle = circles.invariant_circle(parse("gamma"), kappa, 512)
        least = twist(kappa, *np.meshgrid(x, x)).min()
        return status_code(circle.status), least, *_lives(kappa, 2000, 2000, 2000)

    status, least, *lives = _over(angles, scales, answers)
    coords = {"angle": (list(angles), ANGLE), "scale": (scales, "scale s of the forcing")}
    variables = {
        "twist": ([*coords], least, "least ∂x'/∂y of a step"),
        **_labelled_lives([*coords], lives),
        "circle": outcomes([*coords], status),
    }
    return dataset("Near the end of the twist and beyond", coords, variables)


def _over(first, second, answers):
    """Return an array over first × second of each of the numbers that answers(a, b) returns."""
    return np.array([[answers(a, b) for b in second] for a in first], float).transpose(2, 0, 1)


def _lives(kappa, n_cones, n_average, n_escape):
    """Return the steps that the longest-lived start lives, and the others of _LIVES."""
    y, steps = symmetry_line.longest_lived(kappa, n_cones)
    site, a = dominant_centre(kappa)
    _, digits = orbits.rotation_number(np.roll(kappa, -site), a, y, n_average)
    return steps, digits, _first_escape(kappa, n_escape)


def _first_escape(kappa, n_max, precision="double"):
    starts = escape.ensemble(100)
    return escape.first_escape(kappa, *starts, [100], n_max, precision=precision)[0]


def _labelled_lives(dims, lives):
    named = zip(_LIVES.items(), lives, strict=True)
    return {name: (dims, values, words) for (name, words), values in named}
