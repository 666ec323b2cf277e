"""Functions to make and write Datasets: labelled variables, outcomes as CF flags, CSV tables.

Functions import xarray, which takes 0.4 s, when they are called, so that the explorer can send its
page first.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from nasm.planes import TWO_KICKS_AXES
from workflows.figures import files

if TYPE_CHECKING:
    import xarray as xr


def described(long_name: str, units: str = "1", **more: Any) -> dict[str, Any]:
    """Return the attributes of a variable."""
    return {"long_name": long_name, "units": units, **more}


def dataset(
    title: str,
    coords: Mapping[str, Any],
    variables: Mapping[str, Any],
    attrs: Mapping[str, Any] | None = None,
) -> "xr.Dataset":
    """Return a labelled Dataset.

    Parameters
    ----------
    title : str
        Title of the Dataset.
    coords : dict
        {dimension: (values, label)}, or labelled Variables, or coordinates of another Dataset.
    variables : dict
        {name: (dims, values, label)}, or labelled Variables.
    attrs : dict, optional
        Additional attributes of the Dataset.

    Returns
    -------
    xarray.Dataset

    Notes
    -----
    A label is the long name of a dimensionless variable, or the attributes returned by `described`.
    """
    import xarray as xr

    def labelled(dims: Any, values: ArrayLike, label: str | dict[str, Any]) -> tuple:
        return dims, values, described(label) if isinstance(label, str) else label

    own = {dim: labelled(dim, *coord) for dim, coord in coords.items() if isinstance(coord, tuple)}
    variables = {
        name: variable if isinstance(variable, xr.Variable) else labelled(*variable)
        for name, variable in variables.items()
    }
    return xr.Dataset(variables, {**coords, **own}, {"title": title, **(attrs or {})})


def columns(
    dims: str | Sequence[str], labels: Mapping[str, str], values: Iterable[ArrayLike]
) -> dict[str, tuple]:
    """Return variables with common dimensions, from {name: label} and values in the same order."""
    pairs = zip(labels.items(), values, strict=True)
    return {name: (dims, np.array(column), label) for (name, label), column in pairs}


def strengths(
    dims: str | Sequence[str],
    a: ArrayLike,
    b: ArrayLike,
    axes: Mapping[str, str] = TWO_KICKS_AXES,
) -> dict[str, tuple]:
    """Return the labelled variables of a plane's axes, kappa1 and kappa2 by default."""
    return columns(dims, axes, (a, b))


def outcomes(dims: str | Sequence[str], codes: ArrayLike) -> tuple:
    """Return a variable of status codes (see `cube.status_code`) with their meanings."""
    from pipeline.cubes.cube import FLAGS

    return dims, np.asarray(codes).astype("int8"), described("outcome", **FLAGS)


def write(dataset: "xr.Dataset", path: str | Path) -> None:
    """Write a Dataset as CSV, with outcomes as words."""
    table = dataset.to_dataframe()
    for name in table:
        meanings = dataset[name].attrs.get("flag_meanings")
        if meanings is not None:
            codes = dataset[name].attrs["flag_values"]
            table[name] = table[name].map(dict(zip(codes, meanings.split(), strict=True)))
    files.write(path, table.to_csv(float_format="%.12g"))
