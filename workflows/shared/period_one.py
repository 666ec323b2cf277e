"""Period-one orbits over the plane, by exact formulas or by solving one equation."""

import numpy as np
import xarray as xr

from nasm import fixed_points
from nasm.planes import TWO_KICKS_AXES
from nasm.types import FloatArray
from pipeline.cubes.cube import text
from pipeline.sweep.grid import Axis
from workflows.shared.tables import dataset

_SECTION = "arXiv:1606.04824, Sec. IV.A"
_RESIDUE = "Greene's residue; stable if 0 < R < 1"


def primary_dataset(axis: Axis) -> xr.Dataset:
    """Compute residues of the primary points over axis × axis; dims (point, kappa2, kappa1)."""
    kappa2, kappa1 = np.meshgrid(axis.centres, axis.centres, indexing="ij")
    points = [f"({x:g}, {y:g})" for x, y in fixed_points.PRIMARY]
    residue = fixed_points.primary_residue(kappa1, kappa2)
    coords = {"point": text("point", points, "primary point (x, y)"), **_plane(axis)}
    residues = {"residue": (("point", "kappa2", "kappa1"), residue, _RESIDUE)}
    references = {"references": f"{_SECTION} and Fig. 3"}
    return dataset("Primary period-one orbits", coords, residues, references)


def secondary_dataset(axis: Axis) -> xr.Dataset:
    """Find the secondary point near (1/2, 0) over axis × axis; NaN where it does not exist."""
    kappa2, kappa1 = np.meshgrid(axis.centres, axis.centres, indexing="ij")
    z, x, y = fixed_points.secondary(kappa1, kappa2)
    residue = np.full(z.shape, np.nan)
    for index in zip(*np.nonzero(np.isfinite(z)), strict=True):
        residue[index] = fixed_points.residue((kappa1[index], kappa2[index]), x[index], y[index])
    error = np.abs(fixed_points.cubic_estimate(kappa1, kappa2) - z)
    dims, references = ("kappa2", "kappa1"), {"references": f"{_SECTION} and Fig. 4"}
    variables = {
        "z": (dims, z, "distance 2πx - π from (1/2, 0)"),
        "x": (dims, x, "x of the point, in turns"),
        "y": (dims, y, "y of the point"),
        "residue": (dims, residue, _RESIDUE),
        "estimate_error": (dims, error, "error of the cubic estimate of z (sign corrected)"),
    }
    return dataset("Secondary period-one orbits", _plane(axis), variables, references)


def _plane(axis: Axis) -> dict[str, tuple[FloatArray, str]]:
    return {name: (axis.centres, label) for name, label in TWO_KICKS_AXES.items()}
