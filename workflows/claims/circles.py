"""Claims about Algorithm 1 and about images of circles under symmetries (Secs. VI.A to VI.C).

The sections are those of arXiv:1606.04824. This module also finds the largest amplitude of any
circle, which Proposition 1 assumes to be below 1 (Sec. V.B).
"""

from functools import partial
from itertools import product
from time import thread_time
from timeit import repeat

import numpy as np

from nasm import barriers, circles
from nasm.circles import fourier, hull, parameterization
from nasm.maps import kick, step, step_tangent
from nasm.numbers import moebius, parse
from nasm.symmetries import ray
from workflows.claims.map import apart
from workflows.claims.rules import identity, rounding
from workflows.shared.judgement import grade

_KAPPA = (0.4, 0.2)
_POINTS = 512


def golden_circle(kappa):
    """Compute the circle of γ by Newton's method, to rounding accuracy, and certify it."""
    gamma, u = parse("gamma"), np.zeros((len(kappa), _POINTS))
    for _ in range(10):
        u, _ = parameterization.newton_step(gamma, kappa, u)
    error_and_status = circles.newton.certify(gamma, kappa, u)
    return circles.InvariantCircle(gamma, np.array(kappa), u, *error_and_status)


def circle_claims():
    """Judge the claims of Secs. VI.A to VI.C."""
    circle = golden_circle(_KAPPA)
    gamma, exact = circle.omega, circle.u
    first, second, mean = [], [], []
    for distance in (0.1, 0.03, 0.01, 0.003):
        start = (1 - distance) * exact
        mean.append(abs(frames(gamma, _KAPPA, start)["e"][1].mean()))
        u, error = parameterization.newton_step(gamma, _KAPPA, start)
        first.append(error)
        second.append(parameterization.newton_step(gamma, _KAPPA, u)[1])
    order, mean_order = (np.polyfit(np.log(first), np.log(y), 1)[0] for y in (second, mean))
    sizes = 2 ** np.arange(12, 17)
    work = np.polyfit(np.log(sizes), np.log([_step_seconds(gamma, int(n)) for n in sizes]), 1)[0]
    off = frames(gamma, _KAPPA, exact)["shear"] - np.eye(2)[..., None]
    off[0, 1] = 0
    cost = {"order": work, "least": sizes[0], "most": sizes[-1]}
    return {
        "newton": grade({"order": order}, abs(order - 2) < 0.1),
        "reduction": identity(float(np.abs(off).max()), 1e-10),
        "average": grade({"order": mean_order}, mean_order > 1.9),
        "cost": grade(cost, work < 1.5),
        **_symmetries(),
    }


def frames(omega, kappa, u):
    """Compute the properties of the frame M of Algorithm 1 directly from the map.

    Return a dict with "e": M⁻¹(θ + ω) e, shape (2, n); "shear": M⁻¹(θ + ω) DT M(θ), shape
    (2, 2, n); "s": S, and "printed_s": S as printed in the paper, both of shape (n,).
    """
    turn = fourier.turns(omega, u.shape[-1] // 2 + 1)
    x, y, e = invariance(omega, kappa, u)
    tangent = fourier.derivative(np.stack([u[0], y]))
    tangent[0] += 1
    frame = parameterization.symplectic_frame(tangent)
    after = parameterization.symplectic_frame(fourier.rotate(tangent, turn))
    inverse = np.linalg.inv(after.transpose(2, 0, 1)).transpose(1, 2, 0)
    map_tangent = step_tangent(kappa, x, y)
    pushed = np.einsum("abn,bcn->acn", map_tangent, frame)
    printed = np.einsum("an,abn,bn->n", after[:, 0], map_tangent, tangent)
    printed /= np.sum(after[:, 0] ** 2, axis=0) * np.sum(tangent**2, axis=0)
    return {
        "e": np.einsum("abn,bn->an", inverse, e),
        "shear": np.einsum("abn,bcn->acn", inverse, pushed),
        "s": parameterization.twist(map_tangent, frame, after),
        "printed_s": printed,
    }


def invariance(omega, kappa, u):
    """Return x, y of K, and T∘K(θ) - K(θ + ω), shape (2, n), computed with the map itself."""
    n = u.shape[-1]
    turn, theta = fourier.turns(omega, n // 2 + 1), np.arange(n) / n
    y = float(omega) / len(kappa) + u[0] - fourier.rotate(u[-1], turn.conj())
    e = np.stack(step(kappa, theta + u[0], y)) - fourier.rotate(np.stack([u[0], y]), turn)
    e[0] -= theta + float(omega)
    return theta + u[0], y, e


def _step_seconds(omega, n):
    step = partial(parameterization.newton_step, omega, _KAPPA, np.zeros((2, n)))
    return min(
        repeat(step, timer=thread_time, number=1)
    )  # the first call also computes tables for the grid


def _symmetries():
    gamma, two_gamma = parse("gamma"), parse("2gamma")
    standard, other = golden_circle((0.5,)), golden_circle(_KAPPA)
    double = circles.symmetries.repeat(standard, 2)
    # A circle K of S_κ∘R_{-1/2} is also a circle under the forcing (-κ, -κ), up to y → y + 1/2,
    # which turns 2ω into 2ω + 1.
    opposite = circles.symmetries.alternate(circles.symmetries.negate(double))
    single = circles.symmetries.interleave(standard)
    one_less = moebius(gamma, 1, 1)
    negated = circles.symmetries.negate(other)
    alternated = circles.symmetries.alternate(other)
    both = circles.symmetries.alternate(negated)

    def half_turn(kappa, x, y):
        x, y = kick(-kappa[0], x, y)
        return x - 0.5, y

    def rescaled(kappa, x, y):
        x, y = kick(2 * kappa[0], x, 2 * y)
        return x, y / 2

    turned = apart(lambda kappa, x, y: kick(kappa[0], x - 0.5, y), half_turn)
    single_kick = apart(lambda kappa, x, y: step((kappa[0], 0), x, y), rescaled)
    return {
        "associated": _carried(
            (negated, gamma, (-0.4, -0.2)),
            (alternated, one_less, (0.4, -0.2)),
            (both, one_less, (-0.4, 0.2)),
        ),
        "mapsquare": _carried((double, two_gamma, (0.5, 0.5))),
        "stdsymmetry": identity(turned, rounding(1)),
        "circ_symmetry": _carried((opposite, moebius(two_gamma, 1, 1), (-0.5, 0.5))),
        "rescaled": identity(single_kick, rounding(2)),
        "single_kick": _carried(
            (single, gamma, (0.25, 0)), (circles.symmetries.shift(single), gamma, (0, 0.25))
        ),
        "swapped": _carried((circles.symmetries.shift(other), gamma, (0.2, 0.4))),
    }


def _carried(*cases):
    """Judge the cases: each circle must be certified, with the ω and the forcing of its case."""
    right = all(
        circle.certified and circle.omega == omega and np.array_equal(circle.kappa, kappa)
        for circle, omega, kappa in cases
    )
    errors = [invariance(circle.omega, circle.kappa, circle.u)[2] for circle, *_ in cases]
    off = max(np.abs(error).max() for error in errors)
    if not right:
        return identity(np.inf, 1e-12, "not certified with the expected ω and κ; deviation")
    return identity(float(off), 1e-12, "certified; largest |T∘K(θ) - K(θ + ω)|")


def largest_amplitude():
    """Find the largest max y - min y over circles, before the first and the second kick.

    On each of six rays the circles are the last circle, at 0.999 of its breakup or as close to the
    breakup as it can be certified, and the circles of seven fixed ω at several smaller scales,
    if they can be certified there. A circle and its translate by y = 1 confine an orbit to
    |Δy| ≤ 1 + amplitude.
    """
    others = ["gamma", "2gamma", "[0;2,(1)]", "[0;3,(1)]", "[0;4,(1)]", "[0;1,3,(1)]", "[0;8,(1)]"]
    heights = []
    for profile in ray(np.linspace(0, 45, 6)):
        best = barriers.critical_scale(profile, 1e-3)
        _, u = hull.certified_circle(best.omega, profile, best.value, 1e-3)
        if u is not None:
            heights += _heights(best.omega, u)
        for part, omega in product((0.3, 0.6, 0.8, 0.9, 0.97), map(parse, others)):
            circle = circles.invariant_circle(omega, part * best.value * profile, n_max=512)
            if circle.certified:
                heights += _heights(omega, circle.u)
    return max(heights)


def _heights(omega, u):
    """Return max y - min y before each kick, where y_j = x_j - x_{j-1}."""
    before = fourier.rotate(u[-1], fourier.turns(omega, u.shape[-1] // 2 + 1).conj())
    return np.ptp(np.diff(np.vstack([before, u]), axis=0), axis=1).tolist()
