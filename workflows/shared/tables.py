"""What Datasets have in common: described variables, outcomes as CF flags, and CSV tables."""

import numpy as np

from nasm.planes import TWO_KICKS_AXES
from pipeline.cubes.cube import FLAGS


def described(long_name, units="1", **more):
    """Return the attributes of a variable."""
    return {"long_name": long_name, "units": units, **more}


ANGLE = described("direction of the ray in the plane", "degree")


def strengths(dims, a, b, axes=TWO_KICKS_AXES):
    """Return the variables of a plane's axes, kappa1 and kappa2 by default, labelled."""
    named = zip(axes.items(), (a, b), strict=True)
    return {name: (dims, values, described(words)) for (name, words), values in named}


def listed(dim, *names):
    """Return a coordinate of numbers that stand for the names."""
    return dim, np.arange(len(names)), described(dim, names=list(names))


def outcomes(dims, codes):
    """Return a variable of status codes, see `cube.status_code`, with their meanings."""
    return dims, np.asarray(codes).astype("int8"), described("outcome", **FLAGS)


def write(dataset, path):
    """Write a Dataset as CSV: outcomes as words."""
    table = dataset.to_dataframe()
    for name in table:
        words = dataset[name].attrs.get("flag_meanings")
        if words is not None:
            table[name] = table[name].map(dict(enumerate(words.split())))
    table.to_csv(path, float_format="%.12g")
