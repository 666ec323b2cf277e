"""Rays in planes of forcings: their angles, the labels of their circles, and cubes on them."""

from collections.abc import Mapping

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from nasm.arithmetic.reproducible import geometric
from nasm.numbers import NAMES, parse
from nasm.planes import Plane, two_kicks
from nasm.types import FloatArray
from pipeline.cubes.barrier import degenerate_circle
from pipeline.cubes.cube import text
from workflows.shared.tables import described

PAPER_CIRCLES = sorted(map(parse, NAMES), key=float)


def ray_angles(plane: Plane, n: int, n_cusp_rays: int) -> FloatArray:
    """Return the angles of rays that cover a plane.

    Parameters
    ----------
    plane : Plane
        The plane of forcings.
    n : int
        Number of rays, evenly spaced from 0 to 180 degrees, or to 360 where κ and -κ are not
        equivalent.
    n_cusp_rays : int
        For two kicks, number of extra rays on either side of each cusp, at 45° and 135°.
        Their distances from the cusp are spaced logarithmically from 2 to 0.02 degrees. The rays
        through the cusps themselves are included.

    Returns
    -------
    array
        Increasing angles in degrees.
    """
    half = any(turn == 180 and not mirrored for mirrored, turn, _ in plane.symmetries)
    spread = np.linspace(0, 180 if half else 360, n)
    if plane != two_kicks():
        return np.unique(spread.round(9))
    away = np.append(geometric(2.0, 0.02, n_cusp_rays), 0.0)
    cusps = np.concatenate([[45 - away, 45 + away], [135 - away, 135 + away]]).ravel()
    return np.unique(np.concatenate([spread, cusps]).round(9))


def rotated_rays(n: int, n_cusp_rays: int) -> FloatArray:
    """Return the rays of two kicks as angles θ = 45° - φ of the (κ̄, Δκ) plane."""
    return np.unique(
        np.append((45 - ray_angles(two_kicks(), n, n_cusp_rays)) % 180, 180.0).round(9)
    )


def with_degenerate(circle: str, angle: float) -> str:
    """Return, as text, ω and the circle degenerate with it on a ray of two kicks."""
    return circle_text(circle, degenerate_circle(two_kicks(), circle, angle, 1.0))


def circle_text(circle: str, degenerate: str) -> str:
    """Return ω as text, followed by the circle degenerate with it if there is one."""
    return f"{circle}, degenerate with {degenerate}" if degenerate else circle or "undecided"


def by_phase(cubes: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Join cubes on rays for several phases of a rotating map; keys are the phases as text."""
    phase = text("phase", cubes, "exact phase φ0 of the first kick, in turns")
    return xr.concat(cubes.values(), phase, coords="all", combine_attrs="override")


def with_ratio(
    cube: xr.Dataset,
    scale: ArrayLike,
    reference: str,
    name: str = "ratio",
    side: str = "critical_scale",
) -> xr.Dataset:
    """Return the cube with one more variable, the ratio of its scales to those of a reference.

    Parameters
    ----------
    cube : xarray.Dataset
        Scales on rays.
    scale : array
        The scales of the reference on the same rays.
    reference : str
        Description of the reference, for the label.
    name : str
        Name of the new variable.
    side : str
        The variable of the cube that is divided by `scale`.
    """
    ratio = (cube[side] / scale).assign_attrs(described(f"{side} over {reference}"))
    return cube.assign({name: ratio})
