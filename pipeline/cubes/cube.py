"""Cubes and jobs: what a labelled store of results will hold, and the functions that fill it.

A cube is a lazy xarray template (variables, dims, coordinates, units), the length of a tile along
each tiled dimension, and the settings that decide its values. Two cubes with one `config_hash` hold
the same numbers, whoever computes them, in whatever order.
"""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter

import dask.array
import numpy as np
import xarray as xr

from nasm.critical import Status

PAPER = "arXiv:1606.04824"
_OF_ALL = {
    "Conventions": "CF-1.11",
    "references": f"{PAPER}, https://arxiv.org/abs/1606.04824",
    "map": "y' = y + κ_n/(2π) sin 2πx, x' = x + y' mod 1; κ_n has the period of the forcing",
}


@dataclass(frozen=True)
class Cube:
    """The plan of one cube. Every variable has all dims of a tile, in their order."""

    name: str  # in the store
    template: xr.Dataset  # its dims, dtypes, coordinates and attributes; values not computed
    tile: dict[str, int]  # {dim: cells}, the unit of work and of storage
    settings: dict  # JSON-able: what decides the values, besides the coordinates

    def __post_init__(self):
        template = self.template.assign_attrs(_OF_ALL | self.template.attrs)
        object.__setattr__(self, "template", template)

    @property
    def sizes(self):
        return dict(self.template.sizes)

    @cached_property
    def config_hash(self):
        """SHA-256 of coordinates, variables, tiling and settings."""
        digest = hashlib.sha256()
        for name, coordinate in sorted(self.template.coords.items()):
            digest.update(name.encode() + np.ascontiguousarray(coordinate.values).tobytes())
        variables = sorted(self.template.data_vars.items())
        variables = {name: [list(array.dims), str(array.dtype)] for name, array in variables}
        plan = {"variables": variables, "tile": self.tile, "settings": self.settings}
        digest.update(json.dumps(plan, sort_keys=True).encode())
        return digest.hexdigest()


@dataclass(frozen=True)
class Job:
    """A cube, and what computes it; workers must be able to import the functions."""

    cube: Cube
    compute: Callable  # (coords {dim: ndarray} of a tile, settings) → {variable: array}
    predict: Callable  # (coords of a tile, settings) → CPU seconds that `compute` will take
    warm_up: Callable  # () → anything; compiles the kernels of `compute`, once in each worker


def coordinate(dim, values, long_name, units="1", **attrs):
    """Return the coordinate of a dimension, labelled."""
    return xr.Variable(dim, np.asarray(values), {"long_name": long_name, "units": units, **attrs})


def text(dim, words, long_name):
    """Return a variable of words along a dimension, labelled."""
    return xr.Variable(dim, np.array(list(words), dtype=str), {"long_name": long_name})


def angles_of_rays(angles):
    """Return the coordinate `angle`, in degrees."""
    return coordinate("angle", angles, "direction of the ray in the plane", "degree")


def blank(coords, long_name, fill=np.nan, **attrs):
    """Return a variable over the dimensions among `coords`, not computed, of `fill`'s dtype."""
    sizes = {name: c.size for name, c in coords.items() if c.dims == (name,)}
    values = dask.array.full(tuple(sizes.values()), fill, chunks=-1)
    return tuple(sizes), values, {"long_name": long_name, "units": "1", **attrs}


NOT_COMPUTED = -128  # the least int8; a lost or missing chunk of the store reads as that, too
_STATUSES = list(Status)
FLAGS = {
    "flag_values": [NOT_COMPUTED, *range(1, 1 + len(_STATUSES))],
    "flag_meanings": " ".join(["not_computed", *(status.name.lower() for status in _STATUSES)]),
}
"""CF attributes of every variable of status, in sweeps and studies."""

STATUS_SETTING = {"statuses": FLAGS["flag_meanings"].split()[1:]}
"""What a code means is part of what decides the numbers."""


def status_code(status):
    """Return the number that stands for a Status; see FLAGS."""
    return 1 + _STATUSES.index(status)


def fields(answers, names):
    """Return {variable: array of the field that `names` gives for it} and `status`.

    answers : nested lists of what a method answers, e.g. of CriticalScale.
    """
    answers = np.array(answers, dtype=object)
    found = {name: np.vectorize(attrgetter(f), "d")(answers) for name, f in names.items()}
    codes = np.vectorize(lambda answer: status_code(answer.status), "b")(answers)
    return found | {"status": codes}
