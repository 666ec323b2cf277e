"""Period-one orbits over the plane: exact formulas, and one equation to solve."""

import numpy as np
import xarray as xr

from nasm import fixed_points
from nasm.planes import TWO_KICKS_AXES
from workflows.shared.tables import described

_SOURCE = "arXiv:1606.04824, Sec. IV.A"


def primary_dataset(axis):
    """Compute residues of the primary points over axis × axis; dims (point, kappa2, kappa1)."""
    plane = _plane(axis)
    kappa2, kappa1 = np.meshgrid(axis.centres, axis.centres, indexing="ij")
    points = [f"({x:g}, {y:g})" for x, y in fixed_points.PRIMARY]
    residue = fixed_points.primary_residue(kappa1, kappa2)
    words = described("Greene's residue; stable if 0 < R < 1")
    names = described("primary point (x, y)", points=points)
    return xr.Dataset(
        {"residue": (("point", "kappa2", "kappa1"), residue, words)},
        {"point": ("point", range(len(points)), names), **plane},
        {"title": "Primary period-one orbits", "source": f"{_SOURCE} and Fig. 3"},
    )


def secondary_dataset(axis):
    """Find the secondary point next to (1/2, 0) over axis × axis; NaN where it does not exist."""
    kappa2, kappa1 = np.meshgrid(axis.centres, axis.centres, indexing="ij")
    z, x, y = fixed_points.secondary(kappa1, kappa2)
    residue = np.full(z.shape, np.nan)
    for index in zip(*np.nonzero(np.isfinite(z)), strict=True):
        residue[index] = fixed_points.residue((kappa1[index], kappa2[index]), x[index], y[index])
    error = np.abs(fixed_points.cubic_estimate(kappa1, kappa2) - z)
    quantities = {
        "z": (z, "distance 2πx - π from (1/2, 0)"),
        "x": (x, "x of the point, in turns"),
        "y": (y, "y of the point"),
        "residue": (residue, "Greene's residue; stable if 0 < R < 1"),
        "estimate_error": (error, "error of z by the cubic estimate, its sign corrected"),
    }
    return xr.Dataset(
        {
            name: (("kappa2", "kappa1"), values, described(words))
            for name, (values, words) in quantities.items()
        },
        _plane(axis),
        {"title": "Secondary period-one orbits", "source": f"{_SOURCE} and Fig. 4"},
    )


def _plane(axis):
    return {name: (name, axis.centres, described(words)) for name, words in TWO_KICKS_AXES.items()}
