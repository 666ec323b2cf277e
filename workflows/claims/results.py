"""Claims about the boundaries CB_ω of circles (Sec. VI.D), and claims in the discussion (Sec. VII).

circles : the cube `breakdown_residue` for the paper's six ω. barrier : CB_gt on the same rays.
tori : the cube `rotating_tori`. three : the cubes for three kicks, joined along `phase`. tori and
three contain `ratio`, the ratio of their scales to the scales for two kicks. three also contains
`ratio_lower`, the ratio of its lower bounds to the upper bounds for two kicks.
"""

import numpy as np
from scipy.spatial import ConvexHull

from nasm import escape, periodic
from nasm.circles import continuation, hull
from nasm.converse_kam import symmetry_line
from nasm.maps import rotating_forcing, step
from nasm.numbers import NAMES, parse
from nasm.planes import two_kicks
from nasm.symmetries import ray
from workflows.claims.boundary import KAPPA_G
from workflows.claims.map import apart
from workflows.claims.rules import identity, rounding
from workflows.shared.judgement import grade

_PAIRS = {
    "mirror_gamma": ("gamma", "gamma+1"),
    "mirror_2gamma": ("2gamma", "2gamma+1"),
    "mirror_others": ("(5gamma+6)/(4gamma+5)", "(gamma+1)/(4gamma+5)"),
}


def result_claims(circles, barrier, tori, three):
    """Judge the claims of Secs. VI.D and VII."""
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
        "contained": grade(contained, outside == 0),
        "asymmetrical": grade(lopsided, all((off > error).any() for off, error in asymmetry)),
        **{name: _reflection(circles, *pair) for name, pair in _PAIRS.items()},
        "heuristic_1": _heuristic(circles, barrier, NAMES[4]),
        "heuristic_2": _heuristic(circles, barrier, NAMES[5]),
        **hull_claims(circles, barrier),
        **_rotating_map(),
        "third": _third(three),
        "torus": _torus(tori),
    }


def _known_limits():
    """Compare breakups computed by continuation with those derived from reductions of the map."""
    half, full = KAPPA_G[0] / 2, KAPPA_G[0] * np.sqrt(2)
    cases = [(0, name, half) for name in NAMES[:2]] + [(90, name, half) for name in NAMES[:2]]
    cases += [(45, "2gamma", full), (135, "2gamma+1", full)]
    off, beyond = 0.0, 0.0
    for angle, name, exact in cases:
        scale = continuation.critical_scale(parse(name), ray(angle), 1e-6)
        off = np.maximum(off, abs(scale.value / exact - 1))
        beyond = np.maximum(beyond, abs(scale.value - exact) / scale.error)
    return grade({"n": len(cases), "off": off}, beyond <= 1)


def _blow_up():
    """Measure ‖u‖_{H³}/‖u‖_{H²} for certified circles at three distances from the breakup."""
    distances, grown = (1e-2, 3e-3, 1e-3), []
    for angle, name in ((0.0, "gamma"), (30.0, "gamma"), (30.0, "[0;1,3,(1)]")):
        omega, profile = parse(name), ray(angle)
        breakup = periodic.critical_scale(omega, profile).value
        certified = [hull.certified_circle(omega, profile, breakup, d) for d in distances]
        away = [1 - scale / breakup for scale, _ in certified]
        fineness = [continuation.fineness(u) for _, u in certified]
        grown.append(-np.polyfit(np.log(away), np.log(fineness), 1)[0])
    value = {"least": min(grown), "most": max(grown), "nearest": distances[-1]}
    return grade(value, min(grown) > 0.5)


def _bounds():
    """Bound breakups from above by direct iteration, and from below by continuation."""
    excess, deficit = [], []
    for profile in ray([15.0, 30.0]):
        for omega in map(parse, ("[0;1,3,(1)]", "gamma")):
            exact = periodic.critical_scale(omega, profile).value
            deficit.append(1 - continuation.critical_scale(omega, profile).lower / exact)
        shown = symmetry_line.critical_scale(profile, 4000).upper
        excess.append(escape.onset_scale(profile, 10_000, 100) / shown - 1)
    value = {"excess": min(excess), "deficit": min(deficit)}
    return grade(value, min(value.values()) > 0)


def _mirror(circles, name, other):
    """Return |CB_name(φ)/CB_other(180° - φ) - 1| and its error, on rays where both are known."""
    angles = circles.angle.values
    mirrored = angles[np.isin((180 - angles).round(9), angles.round(9))]
    original = circles.sel(circle=str(parse(name)), angle=mirrored)
    image = circles.sel(circle=str(parse(other))).sel(angle=180 - mirrored, method="nearest")
    off = np.abs(original.critical_scale.values / image.critical_scale.values - 1)
    error = (original.error.values + image.error.values) / original.critical_scale.values
    return off[np.isfinite(off)], error[np.isfinite(off)]


def _reflection(circles, name, other):
    off, error = _mirror(circles, name, other)
    text = (
        f"{off.size} pairs of rays, computed separately, differ by up to {off.max():.1e} (relative)"
    )
    return grade(text, off.size > 0 and (off <= error).all())


def _heuristic(circles, barrier, name):
    parts = circles.critical_scale / barrier.critical_scale
    best = parts.sel(circle=str(parse(name))).values
    leads = best >= parts.max("circle").values
    short = 1 - best[leads]
    gap = f"{short.max():.2%}" if leads.any() else "nothing"
    text = (
        f"on {leads.mean():.0%} of {leads.size} rays it is the largest of the six, and there it "
        f"falls short of CB_gt by up to {gap}"
    )
    return grade(text, leads.any() and short.max() < 0.05, leads.any())


def hull_claims(circles, barrier):
    """Judge the claims about the convex hull and the envelope of CB_gt."""
    domain = barrier.sel(angle=slice(0, 45))
    angles = np.deg2rad(two_kicks().unfold(domain.angle.values))
    known = np.isfinite(domain.critical_scale.values)
    points = domain.critical_scale.values * np.stack([np.cos(angles), np.sin(angles)])
    hull = ConvexHull(points[:, :, known].reshape(2, -1).T)
    normals, offsets = hull.equations[:, :2], hull.equations[:, 2]
    outward = normals @ ray(domain.angle.values).T
    reach = np.where(outward > 0, -offsets[:, None] / np.maximum(outward, 1e-300), np.inf).min(0)
    part = (domain.critical_scale / reach).values
    worst = int(np.nanargmin(part))
    closed = ((barrier.upper - barrier.lower) / barrier.critical_scale).values
    is_known = np.isfinite(closed)
    short = 1 - (circles.critical_scale.max("circle") / barrier.critical_scale).values
    within = ((circles.error.max("circle") + barrier.error) / barrier.critical_scale).values
    formed = (short <= within)[np.isfinite(short)]
    return {
        "hull": grade(
            {"part": part[worst], "angle": domain.angle.values[worst]}, part[worst] > 1 - 1e-3
        ),
        "envelope": grade(
            {"closed": is_known.sum(), "rays": is_known.size, "most": np.nanmax(closed)},
            is_known.all(),
            is_known.mean() > 0.9,
        ),
        "six": grade(
            {"share": formed.mean(), "rays": formed.size, "short": np.nanmax(short)},
            formed.all(),
            np.nanmax(short) < 0.05,
        ),
    }


def _rotating_map():
    random = np.random.default_rng(4)

    def differences(kappa):
        mean, amplitude = kappa.mean(), (kappa[1] - kappa[0]) / 2
        printed, other = (rotating_forcing(mean, a, "1/2") for a in (amplitude, -amplitude))
        return printed - kappa, printed - kappa[::-1], other - kappa

    off = np.abs([differences(kappa) for kappa in random.uniform(-1, 1, (100, 2))]).max((0, 2))
    constant = apart(
        lambda kappa, *z: step(rotating_forcing(*kappa, "1/2", 0.25), *z),
        lambda kappa, *z: step(kappa[[0, 0]], *z),
    )
    return {
        "rotating_half": grade({"off": off}, off[0] <= 1e-15, max(off[1:]) <= 1e-15),
        "rotating_quarter": identity(constant, rounding(2)),
    }


def _third(three):
    beyond = (three.ratio_lower.max("phase") > 1).values
    known = three.ratio.notnull().any("phase").values
    share = beyond.sum() / max(known.sum(), 1)
    value = {"phases": three.phase.size, "beyond": beyond.sum(), "known": known.sum()}
    value["most"] = float(three.ratio_lower.max()) - 1
    return grade(value, 0 < share < 0.25, beyond.any(), known.any())


def _torus(tori):
    part = tori.ratio.values[0]
    known = np.isfinite(part)
    outside = part[known] > 1
    share = outside.sum() / max(outside.size, 1)
    value = {"outside": outside.sum(), "rays": outside.size}
    value["most"] = max(part[known], default=np.nan)
    return grade(value, 0 < share < 0.1, share < 0.1, known.any())
