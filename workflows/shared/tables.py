"""What Datasets have in common: labelled variables, outcomes as CF flags, and CSV tables."""

import numpy as np
import xarray as xr

from nasm.planes import TWO_KICKS_AXES
from pipeline.cubes.cube import FLAGS
from workflows.figures import files


def described(long_name, units="1", **more):
    """Return the attributes of a variable."""
    return {"long_name": long_name, "units": units, **more}


def dataset(title, coords, variables, attrs=None):
    """Return a labelled Dataset.

    coords : {dimension: (values, label)}, or a labelled Variable, or that of another Dataset.
    variables : {name: (dims, values, label)}, or labelled Variables.
    attrs : more attributes of the Dataset.

    A label is the long name of a number without unit, or the attributes by `described`.
    """

    def labelled(dims, values, label):
        return dims, values, described(label) if isinstance(label, str) else label

    own = {dim: labelled(dim, *coord) for dim, coord in coords.items() if isinstance(coord, tuple)}
    variables = {
        name: variable if isinstance(variable, xr.Variable) else labelled(*variable)
        for name, variable in variables.items()
    }
    return xr.Dataset(variables, coords | own, {"title": title, **(attrs or {})})


def columns(dims, labels, values):
    """Return variables {name: label} of the same dimensions with their values, in that order."""
    named = zip(labels.items(), values, strict=True)
    return {name: (dims, np.array(one), label) for (name, label), one in named}


def strengths(dims, a, b, axes=TWO_KICKS_AXES):
    """Return the variables of a plane's axes, kappa1 and kappa2 by default, labelled."""
    return columns(dims, axes, (a, b))


def outcomes(dims, codes):
    """Return a variable of status codes, see `cube.status_code`, with their meanings."""
    return dims, np.asarray(codes).astype("int8"), described("outcome", **FLAGS)


def write(dataset, path):
    """Write a Dataset as CSV: outcomes as words."""
    table = dataset.to_dataframe()
    for name in table:
        words = dataset[name].attrs.get("flag_meanings")
        if words is not None:
            codes = dataset[name].attrs["flag_values"]
            table[name] = table[name].map(dict(zip(codes, words.split(), strict=True)))
    files.write(path, table.to_csv(float_format="%.12g"))
