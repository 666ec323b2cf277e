"""Rays of the planes (κ1, κ2) and (κ̄, Δκ), and what cubes say about them.

κ = s·(cos φ, sin φ). CB_gt has the symmetries of the square (arXiv:1606.04824, Sec. III), so that
the cube `barrier` holds the images of rays in the wedge 0 ≤ κ2 ≤ κ1, and is unfolded when read.
"""

import numpy as np

from nasm.numbers import NAMES, parse
from pipeline.cubes.barrier import tie, unfolded
from workflows.parts.tables import ANGLE, described

PAPER_CIRCLES = sorted(map(parse, NAMES), key=float)


def ray_angles(n, tips):
    """Return n angles from 0 to 180 degrees, 45° and 135°, and `tips` more on each side of those.

    Those are spaced logarithmically, from 2 to 0.02 degrees away; the boundary has cusps there.
    """
    away = np.append(np.geomspace(2.0, 0.02, tips), 0.0)
    near = np.concatenate([[45 - away, 45 + away], [135 - away, 135 + away]]).ravel()
    return np.unique(np.concatenate([np.linspace(0, 180, n), near]).round(9))


def rotated_rays(n, tips):
    """Return the rays of `ray_angles` as angles θ = 45° - φ of the (κ̄, Δκ) plane."""
    return np.unique(np.append((45 - ray_angles(n, tips)) % 180, 180.0).round(9))


def with_tie(circle, angle):
    """Return the text of ω, and of the one that is tied with it."""
    other = tie(circle, angle)
    return f"{circle}, tied with {other}" if other else circle or "undecided"


def two_kicks(barrier, angles):
    """Return CB_gt on rays (κ̄, Δκ) = s·(cos θ, sin θ), from the cube `barrier` of 45° - θ."""
    two = unfolded(barrier, 45 - angles)
    two["kappa_mean"] = (two.kappa1 + two.kappa2) / 2
    two["kappa_amplitude"] = (two.kappa1 - two.kappa2) / 2
    for name in ("critical_scale", "error", "lower", "upper"):
        two[name] = two[name].copy(data=two[name] / np.sqrt(2))
    return two.assign_coords(angle=("angle", angles, ANGLE))


def with_ratio(cube, scale, of, name="ratio"):
    """Return the cube with the ratio of its scales to `scale` on the same rays."""
    ratio = cube.critical_scale / scale
    return cube.assign({name: ratio.assign_attrs(described(f"critical_scale over that of {of}"))})
