"""Claims about transport barriers (Sec. V): known limits, and direct computation."""

import numpy as np

from nasm import barriers, escape, periodic
from nasm.maps import kick, step
from nasm.numbers import moebius, parse
from nasm.symmetries import ray
from nasm.verdicts import verdict
from pipeline.cubes.cube import field_arrays
from workflows.claims.circles import largest_amplitude
from workflows.claims.map import apart, both_kicks
from workflows.claims.rules import identity, printed, rounding
from workflows.shared.direct_iteration import INSETS, exponent
from workflows.shared.judgement import agrees, grade
from workflows.shared.rays import with_degenerate

KAPPA_G = printed("0.971635406")
_AXIS = "gamma", "1-gamma", "2-gamma", "gamma+1"
# For each ray: its angle, κ at the breakup in units of κ_G, and the ω of the critical circles.
_KNOWN = {
    "first": (0.0, 0.5, _AXIS),
    "second": (90.0, 0.5, _AXIS),
    "equal": (45.0, 1.0, ("2gamma", "2-2gamma")),
    "opposite": (135.0, 1.0, ("2gamma-1", "3-2gamma")),
}
_SCALE = {"value": "value", "error": "error"}


def boundary_claims(bias, n_max, n_orbits):
    """Judge the claims of Sec. V; `bias` is the result of `direct_iteration.direct_bias` at 45°."""
    gamma, mirrored = (periodic.critical_scale(parse(n), (1.0,)) for n in ("gamma", "1-gamma"))
    error = gamma.error + mirrored.error + abs(gamma.value - mirrored.value)
    amplitude = largest_amplitude()
    return {
        "standard_map": agrees(gamma.value, error, *KAPPA_G),
        **_reductions(),
        **_critical_circles(),
        "amplitudes": grade({"most": amplitude}, amplitude < 1),
        **_square(n_max, n_orbits),
        **_exponents(bias),
        **_insets(n_orbits),
    }


def _reductions():
    def single(i, shear):
        """Compare a step in which only kick i acts with the standard map in x + shear·y and 2y."""

        def stepped(kappa, x, y):
            x, y = step(kappa * np.eye(2)[i], x, y)
            return x + shear * y, 2 * y

        return apart(stepped, lambda kappa, x, y: kick(2 * kappa[i], x + shear * y, 2 * y))

    equal = apart(*(lambda kappa, *z, f=f: f(kappa[[0, 0]], *z) for f in (step, both_kicks)))
    reductions = {"first": single(0, 0), "second": single(1, 1), "equal": equal}
    return {f"reduction_{name}": identity(off, rounding(2)) for name, off in reductions.items()}


def _critical_circles():
    claims = {}
    for name, (angle, factor, circles) in _KNOWN.items():
        last, size = barriers.critical_scale(ray(angle), 1e-4), np.abs(ray(angle)).max()
        omegas = list(map(parse, circles))
        scales = [periodic.critical_scale(omega, ray(angle)) for omega in omegas]
        off = max(abs(scale.value - last.value) / (scale.error + last.error) for scale in scales)
        near = max(np.finfo(float).eps, *(abs(scale.value / last.value - 1) for scale in scales))
        text = (
            f"they break within a relative distance {near:.0e} of CB_gt; the last circle there is "
            f"{with_degenerate(str(last.omega), angle)}"
        )
        holds = last.omega in map(_standard, omegas) and off <= 1
        expected = (factor * number for number in KAPPA_G)
        claims[f"breakup_{name}"] = agrees(last.value * size, last.error * size, *expected)
        claims[f"circles_{name}"] = grade(text, holds, known=np.isfinite(off))
    return claims


def _standard(omega):
    """Return the representative in [0, 1] of ω, -ω and ω + 2, whose circles are equivalent."""
    omega = moebius(omega, 1, -2 * round(float(omega) / 2))
    return omega if float(omega) > 0 else moebius(omega, -1, 0)


def _square(n_max, n_orbits):
    phi, effort = np.array([10.0, 20, 30, 40]), (max(n_max // 10, 1000), min(n_orbits, 100))
    angles = np.stack([phi, 90 - phi, 180 - phi, 90 + phi])  # angles and their images
    direct = np.vectorize(lambda a: escape.onset_scale(ray(a), *effort))(angles)
    exact = field_arrays(
        np.vectorize(lambda a: barriers.critical_scale(ray(a), 1e-3))(angles), _SCALE
    )
    scale, error = exact["value"], exact["error"]
    apart, excess = np.abs(direct[::2] / direct[1::2] - 1), (direct / scale - 1).min()
    off, allowed = np.abs(scale - scale[0]).max(), (error[1:] + error[0]).max()
    value = {"n": apart.size, "apart": apart.max(), "excess": excess}
    all_escape = np.isfinite(direct).all()
    if not all_escape:
        value = "on some of these rays no orbit escapes within the step limit"
    return {
        "direct_symmetric": grade(value, apart.max() < 1e-14, apart.max() < excess, all_escape),
        "square": identity(
            off, allowed, f"{angles.size} rays computed separately: largest difference"
        ),
    }


def _exponents(bias):
    n, off = bias.n.values, bias.values
    windows = [(n >= first) & (n <= 30 * first) for first in n[n <= n[-1] / 30]]
    slopes = [exponent(n[w], off[w])[0] for w in windows if np.isfinite(off[w]).sum() > 4]
    (eta, error), known = exponent(n, off), len(slopes) > 0
    lowest, highest = min(slopes, default=np.nan), max(slopes, default=np.nan)
    text = (
        f"η = {eta:.2f} ± {error:.2f} for N = {n[0]} to {n[-1]}; {lowest:.2f} to {highest:.2f} "
        "over windows in which N grows 30-fold"
    )
    values, theory = {"eta": 2.681, "eta_large": 3.322}, 3.012
    spread = max(abs(number - theory) for number in values.values())
    claims = {"eta_theory": grade(text, abs(eta - theory) <= spread, known=known)}
    for name, number in values.items():
        within = lowest <= number <= highest
        claims[name] = grade(text, abs(eta - number) <= 2 * error, within, known)
    return claims


def _insets(n_orbits):
    """Judge whether points are "close" to CB_gt: within the error of direct iteration, N = 10⁵."""
    n_max, claims = 100_000, {}
    for number, point in enumerate(INSETS, 1):
        answer = verdict(point)
        excess = 1 / answer.boundary.value - 1
        direct = escape.onset_scale(point, n_max, n_orbits)
        width = direct / answer.boundary.value - 1
        side = "beyond" if excess > 0 else "inside"
        text = (
            f"{answer.answer.value}: {abs(excess):.2%} {side} CB_gt on its ray, where direct "
            f"iteration up to N = {n_max} puts the boundary {width:.2%} beyond it"
        )
        known = np.isfinite(excess + width)
        claims[f"inset_{number}"] = grade(text, abs(excess) <= width, known=known)
    return claims
