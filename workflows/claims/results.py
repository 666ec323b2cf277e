"""Claims on the boundaries CB_ω of circles (Sec. VI.D).

circles : the cube `breakdown_residue` of the paper's six ω. barrier : CB_gt on the same rays.
"""

import numpy as np

from nasm import escape, periodic
from nasm.circles import continuation
from nasm.converse_kam import symmetry_line
from nasm.numbers import NAMES, parse
from nasm.symmetries import ray
from workflows.claims.boundary import KAPPA_G
from workflows.shared.rules import graded

_PAIRS = {
    "mirror_gamma": ("gamma", "gamma+1"),
    "mirror_2gamma": ("2gamma", "2gamma+1"),
    "mirror_others": ("(5gamma+6)/(4gamma+5)", "(gamma+1)/(4gamma+5)"),
}


def result_claims(circles, barrier):
    """Judge Sec. VI.D."""
    ratio = (circles.critical_scale / barrier.critical_scale).values
    allowed = ((circles.error + barrier.error) / barrier.critical_scale).values
    known = np.isfinite(ratio)
    outside = int((ratio - 1 > allowed)[known].sum())
    contained = {"outside": outside, "known": known.sum(), "rays": ratio.shape[1]}
    contained["most"] = np.nanmax(ratio) - 1
    asymmetry = [_mirror(circles, name, name) for name in NAMES]
    lopsided = {"least": min(off.max() for off, _ in asymmetry)}
    return {
        "known_limits": _known_limits(),
        "blow_up": _blow_up(),
        "bounds": _bounds(),
        "contained": graded(contained, outside == 0),
        "asymmetrical": graded(lopsided, all((off > error).any() for off, error in asymmetry)),
        **{name: _reflection(circles, *pair) for name, pair in _PAIRS.items()},
        "heuristic_1": _heuristic(circles, barrier, NAMES[4]),
        "heuristic_2": _heuristic(circles, barrier, NAMES[5]),
    }


def _known_limits():
    """Compare breakups by continuation with those that reductions of the map tell."""
    half, full = KAPPA_G[0] / 2, KAPPA_G[0] * np.sqrt(2)
    cases = [(0, name, half) for name in NAMES[:2]] + [(90, name, half) for name in NAMES[:2]]
    cases += [(45, "2gamma", full), (135, "2gamma+1", full)]
    off, beyond = 0.0, 0.0
    for angle, name, exact in cases:
        found = continuation.critical_scale(parse(name), ray(angle), 1e-6)
        off = np.maximum(off, abs(found.value / exact - 1))
        beyond = np.maximum(beyond, abs(found.value - exact) / found.error)
    return graded({"n": len(cases), "off": off}, beyond <= 1)


def _blow_up():
    """Measure ‖u‖_{H³}/‖u‖_{H²} of certified circles at three distances from the breakup."""
    distances, grown = (1e-2, 3e-3, 1e-3), []
    for angle, name in ((0.0, "gamma"), (30.0, "gamma"), (30.0, "[0;1,3,(1)]")):
        omega, profile = parse(name), ray(angle)
        breakup = periodic.critical_scale(omega, profile).value
        found = [continuation.certified_circle(omega, profile, breakup, d) for d in distances]
        away = [1 - scale / breakup for scale, _ in found]
        fineness = [continuation.fineness(u) for _, u in found]
        grown.append(-np.polyfit(np.log(away), np.log(fineness), 1)[0])
    value = {"least": min(grown), "most": max(grown), "nearest": distances[-1]}
    return graded(value, min(grown) > 0.5)


def _bounds():
    """Bound breakups by direct iteration from above, by continuation from below."""
    excess, deficit = [], []
    for profile in ray([15.0, 30.0]):
        for omega in map(parse, ("[0;1,3,(1)]", "gamma")):
            exact = periodic.critical_scale(omega, profile).value
            deficit.append(1 - continuation.critical_scale(omega, profile).lower / exact)
        shown = symmetry_line.critical_scale(profile, 4000).upper
        excess.append(escape.critical_scale(profile, 10_000, 100).upper / shown - 1)
    value = {"excess": min(excess), "deficit": min(deficit)}
    return graded(value, min(value.values()) > 0)


def _mirror(circles, name, other):
    """Return |CB_name(φ)/CB_other(180° - φ) - 1| and its error, where both are known."""
    angles = circles.angle.values
    mirrored = angles[np.isin((180 - angles).round(9), angles.round(9))]
    here = circles.sel(circle=str(parse(name)), angle=mirrored)
    there = circles.sel(circle=str(parse(other))).sel(angle=180 - mirrored, method="nearest")
    off = np.abs(here.critical_scale.values / there.critical_scale.values - 1)
    error = (here.error.values + there.error.values) / here.critical_scale.values
    return off[np.isfinite(off)], error[np.isfinite(off)]


def _reflection(circles, name, other):
    off, error = _mirror(circles, name, other)
    text = f"{off.size} pairs of rays, computed apart, differ by up to {off.max():.1e}, in parts"
    return graded(text, off.size > 0 and (off <= error).all())


def _heuristic(circles, barrier, name):
    parts = circles.critical_scale / barrier.critical_scale
    best = parts.sel(circle=str(parse(name))).values
    leads = best >= parts.max("circle").values
    short = 1 - best[leads]
    gap = f"{short.max():.2%}" if leads.any() else "nothing"
    text = (
        f"on {leads.mean():.0%} of {leads.size} rays it is the largest of the six, and falls "
        f"short of CB_gt by up to {gap} there"
    )
    return graded(text, leads.any() and short.max() < 0.05, leads.any())
