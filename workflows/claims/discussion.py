"""Claims of the discussion (Sec. VII): CB_gt and all CB_ω, and rotating standard maps.

circles, barrier : as in `results`. tori : the cube `rotating_tori`, and three : the cubes of three
kicks by phase, with their `ratio` to two kicks, and `ratio_lower`, of lower to two's upper bound.
"""

import numpy as np

from nasm.maps import rotating_forcing, step
from nasm.planes import two_kicks
from nasm.symmetries import ray
from workflows.claims.map import apart
from workflows.claims.rules import identity, rounding
from workflows.shared.rules import graded


def discussion_claims(circles, barrier, tori, three):
    """Judge Sec. VII."""
    return {
        **hull_claims(circles, barrier),
        **_rotating_map(),
        "third": _third(three),
        "torus": _torus(tori),
    }


def hull_claims(circles, barrier):
    from scipy.spatial import ConvexHull

    wedge = barrier.sel(angle=slice(0, 45))
    angles = np.deg2rad(two_kicks().unfold(wedge.angle.values))
    known = np.isfinite(wedge.critical_scale.values)
    points = wedge.critical_scale.values * np.stack([np.cos(angles), np.sin(angles)])
    hull = ConvexHull(points[:, :, known].reshape(2, -1).T)
    normals, offsets = hull.equations[:, :2], hull.equations[:, 2]
    outward = normals @ ray(wedge.angle.values).T
    reach = np.where(outward > 0, -offsets[:, None] / np.maximum(outward, 1e-300), np.inf).min(0)
    part = (wedge.critical_scale / reach).values
    worst = int(np.nanargmin(part))
    closed = ((barrier.upper - barrier.lower) / barrier.critical_scale).values
    there = np.isfinite(closed)
    short = 1 - (circles.critical_scale.max("circle") / barrier.critical_scale).values
    within = ((circles.error.max("circle") + barrier.error) / barrier.critical_scale).values
    formed = (short <= within)[np.isfinite(short)]
    return {
        "hull": graded(
            {"part": part[worst], "angle": wedge.angle.values[worst]},
            np.nanmin(part) > 1 - 1e-3,
        ),
        "envelope": graded(
            {"closed": there.sum(), "rays": there.size, "most": np.nanmax(closed)},
            there.all(),
            there.mean() > 0.9,
        ),
        "six": graded(
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
        "rotating_half": graded({"off": off}, off[0] <= 1e-15, max(off[1:]) <= 1e-15),
        "rotating_quarter": identity(constant, rounding(2)),
    }


def _third(three):
    beyond = (three.ratio_lower.max("phase") > 1).values
    known = three.ratio.notnull().any("phase").values
    share = beyond.sum() / max(known.sum(), 1)
    value = {"phases": three.phase.size, "beyond": beyond.sum(), "known": known.sum()}
    value["most"] = float(three.ratio_lower.max()) - 1
    return graded(value, 0 < share < 0.25, beyond.any(), known.any())


def _torus(tori):
    part = tori.ratio.values[0]
    known = np.isfinite(part)
    outside = part[known] > 1
    share = outside.sum() / max(outside.size, 1)
    value = {"outside": outside.sum(), "rays": outside.size}
    value["most"] = max(part[known], default=np.nan)
    return graded(value, 0 < share < 0.1, share < 0.1, known.any())
