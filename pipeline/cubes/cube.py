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
    """The plan of one cube.

    name : its name in the store.
    template : Dataset of the right dims, dtypes, coordinates and attributes, values not computed.
    tile : {dim: cells}, the unit of work and of storage; every variable has all of these dims, in
        this order.
    settings : JSON-able, everything besides the coordinates that decides the values.
    """

    name: str
    template: xr.Dataset
    tile: dict[str, int]
    settings: dict

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
        variables = {
            k: [list(v.dims), str(v.dtype)] for k, v in sorted(self.template.data_vars.items())
        }
        plan = {"variables": variables, "tile": self.tile, "settings": self.settings}
        digest.update(json.dumps(plan, sort_keys=True).encode())
        return digest.hexdigest()


@dataclass(frozen=True)
class Job:
    """A cube, and what computes it; workers must be able to import the functions.

    cube : Cube.
    compute : (coords of a tile, settings) → {variable: array}; coords are {dim: ndarray}.
    predict : (coords of a tile, settings) → CPU seconds that `compute` will take.
    warm_up : () → anything; compiles the kernels of `compute`, once in each worker.
    """

    cube: Cube
    compute: Callable
    predict: Callable
    warm_up: Callable


def coordinate(dim, values, long_name, units="1", **attrs):
    """Return the coordinate of a dimension, labelled."""
    return xr.Variable(dim, np.asarray(values), {"long_name": long_name, "units": units, **attrs})


def text(dim, words, long_name):
    """Return a variable of words along a dimension, labelled."""
    return xr.Variable(dim, np.array(list(words), dtype=str), {"long_name": long_name})


def blank(coords, long_name, fill=np.nan, **attrs):
    """Return a variable over `coords` that no tile has written; it has the dtype of `fill`."""
    values = dask.array.full(tuple(c.size for c in coords.values()), fill, chunks=-1)
    return tuple(coords), values, {"long_name": long_name, "units": "1", **attrs}


_STATUSES = list(Status)
FLAGS = {
    "flag_values": list(range(1 + len(_STATUSES))),
    "flag_meanings": " ".join(["not_computed", *(status.name.lower() for status in _STATUSES)]),
}
"""CF attributes of every variable of status, in sweeps and studies; 0 is what no tile wrote."""

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

    def array_of(field):
        return np.vectorize(attrgetter(field), otypes=[float])(answers)

    codes = np.vectorize(lambda answer: status_code(answer.status), otypes=["int8"])(answers)
    return {name: array_of(field) for name, field in names.items()} | {"status": codes}
