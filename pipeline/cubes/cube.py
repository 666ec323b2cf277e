"""Cubes and jobs: what a labelled store of results will hold, and the functions that fill it.

A cube is a lazy xarray template (variables, dims, coordinates, units), the length of a tile along
each tiled dimension, and the settings that decide its values. Two cubes with one `config_hash` hold
the same numbers, whoever computes them, in whatever order; see `nasm.arithmetic.reproducible`. Only
what is proved in the time allowed depends on the machine. A cube that no tiles fill, `untiled`, is
decided by its settings alone, which are known before it is computed.
"""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from numbers import Integral, Real
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
        template = self.template.assign_attrs(plain(_OF_ALL | self.template.attrs))
        for variable in template.variables.values():
            variable.attrs = plain(variable.attrs)
        object.__setattr__(self, "template", template)

    @property
    def tile_counts(self):
        """The number of tiles along each tiled dimension."""
        return tuple(-(-self.template.sizes[dim] // length) for dim, length in self.tile.items())

    @property
    def computed(self):
        """Names of the variables that tiles fill, data or coordinates: those without values yet."""
        return [name for name, array in self.template.variables.items() if array.chunks]

    @property
    def attributes(self):
        """The settings as attributes of the cube in a store."""
        return plain(self.settings)

    def filled(self, arrays):
        """Return the cube as a Dataset that holds {variable: array}."""
        values = {key: self.template[key].copy(data=array) for key, array in arrays.items()}
        return self.template.assign(values)

    @cached_property
    def config_hash(self):
        """SHA-256 of coordinates, variables, tiling and settings; of settings without tiles."""
        digest = hashlib.sha256()
        known, variables = self.template.coords.keys() - {*self.computed}, {}
        for name, array in sorted(self.template.variables.items()) if self.tile else ():
            if name in known:
                digest.update(name.encode() + np.ascontiguousarray(array.values).tobytes())
            else:
                variables[name] = [list(array.dims), str(array.dtype)]
        plan = {"variables": variables, "tile": self.tile, "settings": self.settings}
        digest.update(json.dumps(plan, sort_keys=True).encode())
        return digest.hexdigest()


def untiled(name, **settings):
    """Return the plan of a cube without tiles, whose settings decide all that it will hold."""
    return Cube(name, xr.Dataset(), {}, settings)


@dataclass(frozen=True)
class Job:
    """A cube, and what computes it; cloudpickle brings `compute` and `warm_up` to workers."""

    cube: Cube
    compute: Callable  # (coords {dim: ndarray} of a tile, settings) → {variable: array}
    predict: Callable  # (coords of a tile, settings) → CPU seconds that `compute` will take
    warm_up: Callable  # () → anything; compiles the kernels of `compute`, once in each worker


def plain(attrs):
    """Return attributes as every format keeps them: text, numbers, lists of numbers, else JSON."""
    return {name: _plain(value) for name, value in attrs.items()}


def _plain(value):
    if isinstance(value, list | tuple) and all(isinstance(each, Real) for each in value):
        return [_plain(each) for each in value]
    if isinstance(value, Integral) and abs(value) >= 2**31:  # netCDF 3 has no such integers
        return float(value)
    return value if isinstance(value, str | Real) else json.dumps(value, ensure_ascii=False)


def coordinate(dim, values, long_name, units="1", **attrs):
    """Return the coordinate of a dimension, labelled."""
    return xr.Variable(dim, np.asarray(values), {"long_name": long_name, "units": units, **attrs})


def text(dim, words, long_name):
    """Return a variable of words along a dimension, labelled.

    "" stands for no text. A reader of the store gets NaN for it, as for all that a join of two
    cubes leaves without a value: xarray cannot join zarr's own type of text.
    """
    label = {"long_name": long_name, "missing_value": ""}
    return xr.Variable(dim, np.array(list(words), dtype=str), label)


def angles_of_rays(angles):
    return coordinate("angle", angles, "direction of the ray in the plane", "degree")


def blank(coords, long_name, fill=np.nan, **attrs):
    """Return a variable over the dimensions among `coords`, not computed, of `fill`'s dtype."""
    sizes = {name: c.size for name, c in coords.items() if c.dims == (name,)}
    values = dask.array.full(tuple(sizes.values()), fill, chunks=-1)
    return xr.Variable(tuple(sizes), values, {"long_name": long_name, "units": "1", **attrs})


NOT_COMPUTED = -128  # the least int8; a lost or missing chunk of the store reads as that, too
_STATUSES = list(Status)
NO_MEAN = "not a quantity: do not interpolate or average it"


def flags(meanings):
    """Return the CF attributes of a variable of codes: 1, 2, … for the meanings, in their order."""
    return {
        "comment": NO_MEAN,
        "flag_values": [NOT_COMPUTED, *range(1, 1 + len(meanings))],
        "flag_meanings": " ".join(["not_computed", *meanings]),
    }


FLAGS = flags([status.name.lower() for status in _STATUSES])
"""Those of every variable of status, in sweeps and studies."""
# What a code means is part of what decides the numbers.
STATUS_SETTING = {"statuses": FLAGS["flag_meanings"].split()[1:]}


def status_code(status):
    """Return the number that stands for a Status; see FLAGS."""
    return 1 + _STATUSES.index(status)


def fields(answers, names):
    """Return {variable: array of the field that `names` gives for it} and `status`.

    answers : nested lists of what a method answers, e.g. of CriticalScale.
    """
    answers = np.array(answers, dtype=object)
    found = {name: np.vectorize(attrgetter(f), "d")(answers) for name, f in names.items()}
    return found | {"status": codes(answers, lambda answer: status_code(answer.status))}


def codes(answers, code_of):
    """Return the array of the code of each answer, int8; `answers` are nested lists."""
    return np.vectorize(code_of, "b")(np.array(answers, dtype=object))
