"""Rays of planes of forcings, and what cubes say about them."""

import numpy as np
import xarray as xr

from nasm.arithmetic.reproducible import geometric
from nasm.numbers import NAMES, parse
from nasm.planes import two_kicks
from pipeline.cubes.barrier import degenerate_circle
from pipeline.cubes.cube import text
from workflows.shared.tables import described

PAPER_CIRCLES = sorted(map(parse, NAMES), key=float)


def ray_angles(plane, n, n_cusp_rays):
    """Return n angles from 0 to 180 degrees, or to 360 in a plane where κ and -κ differ.

    For two kicks 45° and 135°, too, where the boundary has cusps, and `n_cusp_rays` more on each
    side of those, spaced logarithmically, from 2 to 0.02 degrees away.
    """
    half = any(turn == 180 and not mirrored for mirrored, turn, _ in plane.symmetries)
    spread = np.linspace(0, 180 if half else 360, n)
    if plane != two_kicks():
        return np.unique(spread.round(9))
    away = np.append(geometric(2.0, 0.02, n_cusp_rays), 0.0)
    near = np.concatenate([[45 - away, 45 + away], [135 - away, 135 + away]]).ravel()
    return np.unique(np.concatenate([spread, near]).round(9))


def rotated_rays(n, n_cusp_rays):
    """Return the rays of two kicks as angles θ = 45° - φ of the (κ̄, Δκ) plane."""
    return np.unique(
        np.append((45 - ray_angles(two_kicks(), n, n_cusp_rays)) % 180, 180.0).round(9)
    )


def with_tie(circle, angle):
    """Return the text of ω, and of the one that is tied with it on that ray of two kicks."""
    return named(circle, degenerate_circle(two_kicks(), circle, angle, 1.0))


def named(circle, tied):
    """Return the text of ω, and of the one that is tied with it, if there is one."""
    return f"{circle}, tied with {tied}" if tied else circle or "undecided"


def by_phase(cubes):
    """Join cubes on rays of several phases of a rotating map, {text of the phase: Dataset}."""
    phase = text("phase", cubes, "phase φ0 of the first kick, in turns, exactly")
    return xr.concat(cubes.values(), phase, coords="all", combine_attrs="override")


def with_ratio(cube, scale, words, name="ratio", side="critical_scale"):
    """Return the cube with the ratio of its scales to `scale`, in words, on the same rays."""
    ratio = (cube[side] / scale).assign_attrs(described(f"{side} over {words}"))
    return cube.assign({name: ratio})
