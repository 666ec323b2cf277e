"""Cubes and jobs: the plan of a labelled store of results, and the functions that fill it.

A cube consists of a lazy xarray template (variables, dims, coordinates, units), the length of a
tile along each tiled dimension, and the settings that determine its values. Two cubes with the same
`config_hash` contain the same numbers, no matter on which machine or in what order they are
computed; see `nasm.arithmetic.reproducible`. The only exceptions are bounds that are proved within
a time limit; these depend on the machine. A cube without tiles (see `untiled`) is identified by its
settings alone, which are known before it is computed.
"""

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from numbers import Integral, Real
from operator import attrgetter
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from nasm.results import Status
from pipeline.provenance import PROGRAM, Code, code_of

if TYPE_CHECKING:
    from pipeline.sweep.grid import Axis

PAPER = "arXiv:1606.04824"
_COMMON_ATTRIBUTES = {
    "Conventions": "CF-1.11",
    "references": f"{PAPER}, https://arxiv.org/abs/1606.04824",
    "map": "y' = y + κ_n/(2π) sin 2πx, x' = x + y' mod 1; κ_n has the period of the forcing",
}
_ANCILLARY = "error", "digits", "lower", "upper", "period", "level", "status", "method"
"""Names of variables that describe the main variable, i.e. the first variable not listed here."""

Coords: TypeAlias = dict[str, np.ndarray]
"""The values of each coordinate in one tile: numbers or strings."""

Settings: TypeAlias = dict[str, Any]
"""Values that JSON can represent: numbers, strings, and lists and objects of these."""

Arrays: TypeAlias = dict[str, Any]
"""The values of each computed variable in one tile; `certificates`, if there are any, are bytes."""

Labels: TypeAlias = dict[str, xr.Variable]
"""Variables by name: coordinates, or variables that are not computed yet."""


@dataclass(frozen=True)
class Cube:
    """The plan of one cube. Every computed variable has all tiled dims, in the same order.

    Attributes
    ----------
    name : str
        Name of the cube in a store.
    template : xr.Dataset
        Coordinates, and variables with dims, dtypes and attributes but without values.
    tile : dict of str to int
        Number of cells per tile along each tiled dim. A tile is the unit of work and of storage.
    settings : dict
        Everything besides the coordinates that determines the values; must be JSON-serializable.

    Examples
    --------
    >>> import xarray as xr
    >>> from pipeline.cubes.cube import Cube, blank, coordinate
    >>> labels = {"n": coordinate("n", range(6), "number")}
    >>> template = xr.Dataset({"power": blank(labels, "power of n")}, labels)
    >>> cube = Cube("powers", template, {"n": 4}, {"exponent": 2})
    >>> cube.tile_counts, cube.computed
    ((2,), ['power'])
    """

    name: str
    template: xr.Dataset
    tile: dict[str, int]
    settings: Settings

    def __post_init__(self) -> None:
        attributes = plain_attributes(_COMMON_ATTRIBUTES | self.template.attrs)
        template = self.template.assign_attrs(attributes)
        for variable in template.variables.values():
            variable.attrs = plain_attributes(variable.attrs)
            variable.attrs.pop("ancillary_variables", None)
        main = next((v for name, v in template.data_vars.items() if name not in _ANCILLARY), None)
        if main is not None:
            beside = [name for name in _ANCILLARY if name in template.data_vars]
            if names := [name for name in beside if {*template[name].dims} <= {*main.dims}]:
                main.attrs["ancillary_variables"] = " ".join(names)
        object.__setattr__(self, "template", template)

    @property
    def tile_counts(self) -> tuple[int, ...]:
        """The number of tiles along each tiled dimension."""
        return tuple(-(-self.template.sizes[dim] // length) for dim, length in self.tile.items())

    @property
    def computed(self) -> list[str]:
        """Names of the data variables and coordinates whose values the tiles will provide."""
        return [str(name) for name, array in self.template.variables.items() if array.chunks]

    @property
    def attributes(self) -> dict[str, Any]:
        """The settings as attributes of the cube in a store."""
        return plain_attributes(self.settings)

    def filled(self, arrays: Mapping[str, np.ndarray]) -> xr.Dataset:
        """Return the cube as a Dataset with the values {variable: array}."""
        values = {key: self.template[key].copy(data=array) for key, array in arrays.items()}
        return self.template.assign(values).assign_attrs(source=PROGRAM)

    @cached_property
    def config_hash(self) -> str:
        """SHA-256 of coordinates, variables, tiling and settings; of settings alone if untiled."""
        digest = hashlib.sha256()
        known, variables = self.template.coords.keys() - {*self.computed}, {}
        for name, array in sorted(self.template.variables.items()) if self.tile else ():
            if name in known:
                digest.update(str(name).encode() + np.ascontiguousarray(array.values).tobytes())
            else:
                variables[name] = [list(array.dims), str(array.dtype)]
        plan = {"variables": variables, "tile": self.tile, "settings": self.settings}
        digest.update(json.dumps(plan, sort_keys=True).encode())
        return digest.hexdigest()


def untiled(name: str, **settings: Any) -> Cube:
    """Return the plan of a cube without tiles, identified by its settings alone.

    Examples
    --------
    >>> from pipeline.cubes.cube import untiled
    >>> untiled("table", tol=1e-3).attributes
    {'tol': 0.001}
    """
    return Cube(name, xr.Dataset(), {}, settings)


@dataclass(frozen=True)
class Job:
    """A cube, and the functions that compute it, which are sent to workers by cloudpickle.

    Attributes
    ----------
    cube : Cube
    compute : callable
        (coordinates of a tile, settings) → {variable: array}.
    predict : callable
        (coordinates of a tile, settings) → CPU seconds that `compute` will take.
    warm_up : callable
        () → anything; compiles the kernels that `compute` uses, once in each worker.
    call : str
        The call that created the job; "" if no function of `pipeline.jobs` created it.
    """

    cube: Cube
    compute: Callable[[Coords, Settings], Arrays]
    predict: Callable[[Coords, Settings], float]
    warm_up: Callable[[], object]
    call: str = ""

    @cached_property
    def code(self) -> Code:
        """The code that `compute` depends on; see `pipeline.provenance`."""
        return code_of(self.compute)


def plain_attributes(attributes: Mapping[Any, Any]) -> dict[str, Any]:
    """Return attributes in types that every format can store: text, numbers, arrays, lists, JSON.

    Examples
    --------
    >>> from pipeline.cubes.cube import plain_attributes
    >>> plain_attributes({"n": 2, "circle": {"omega": "gamma"}})
    {'n': 2, 'circle': '{"omega": "gamma"}'}
    """
    return {str(name): _plain(value) for name, value in attributes.items()}


def _plain(value: Any) -> Any:
    """Return one attribute as text, a number, an array or list of numbers, or JSON."""
    if isinstance(value, np.ndarray):
        return value
    if isinstance(value, list | tuple) and all(isinstance(each, Real) for each in value):
        return [_plain(each) for each in value]
    if isinstance(value, Integral) and abs(int(value)) >= 2**31:  # netCDF 3 has no such integers
        return float(value)
    return value if isinstance(value, str | Real) else json.dumps(value, ensure_ascii=False)


def coordinate(
    dim: str | tuple[str, ...], values: Any, long_name: str, units: str = "1", **attrs: Any
) -> xr.Variable:
    """Return a labelled coordinate.

    Parameters
    ----------
    dim : str or tuple of str
        Dimension or dimensions of the coordinate.
    values : array_like
        Values of the coordinate.
    long_name, units : str
        Attributes of the CF conventions; `attrs` are additional attributes.
    """
    return xr.Variable(dim, np.asarray(values), {"long_name": long_name, "units": units, **attrs})


def cells_along(axes: Iterable["Axis"], long_names: Mapping[str, str]) -> dict[str, xr.Variable]:
    """Return the coordinates and the ends of the cells along axes, beginning with the last axis.

    Parameters
    ----------
    axes : iterable of Axis
        Cells along each axis.
    long_names : mapping of str to str
        Name and description of each axis.
    """
    coords = {}
    for dim, axis in reversed([*zip(long_names, axes, strict=True)]):
        ends = f"{dim}_bounds"
        coords[dim] = coordinate(dim, axis.centres, long_names[dim], bounds=ends)
        coords[ends] = coordinate((dim, "bound"), axis.bounds, "ends of the cells")
    return coords


def text(dim: str, texts: Iterable[str], long_name: str) -> xr.Variable:
    """Return a labelled variable of strings along a dimension.

    "" represents a missing string. When a cube is read from a store, "" becomes NaN, which also
    marks values that are missing after two cubes are joined. This conversion is necessary because
    xarray cannot join strings of zarr's own type.
    """
    label = {"long_name": long_name, "missing_value": ""}
    return xr.Variable(dim, np.array(list(texts), dtype=str), label)


def angles_of_rays(angles: ArrayLike) -> xr.Variable:
    """Return the coordinate `angle` of rays, in degrees."""
    return coordinate("angle", angles, "direction of the ray in the plane", "degree")


def blank(
    coords: Mapping[str, xr.Variable],
    long_name: str,
    fill: float | np.generic = np.nan,
    **attrs: Any,
) -> xr.Variable:
    """Return a variable whose values are not computed yet, with the dimensions of `coords`.

    Parameters
    ----------
    coords : mapping of str to xr.Variable
        Each dimension coordinate adds its dimension; other coordinates are ignored.
    long_name : str
        Description of the variable; `attrs` are additional attributes.
    fill : float or NumPy scalar
        Fill value, which also determines the dtype of the variable.
    """
    import dask.array  # takes 0.3 s, and workers do not need it

    sizes = {name: c.size for name, c in coords.items() if c.dims == (name,)}
    values = dask.array.full(tuple(sizes.values()), fill, chunks=-1)
    return xr.Variable(tuple(sizes), values, {"long_name": long_name, "units": "1", **attrs})


NOT_COMPUTED = -128
"""Code of values that are not computed, or whose chunk is missing: the smallest int8."""

NO_MEAN = "not a quantity: do not interpolate or average it"
_STATUSES = list(Status)


def flags(meanings: Iterable[str]) -> dict[str, Any]:
    """Return the CF attributes of a variable whose codes 1, 2, … have these meanings, in order."""
    numbered = enumerate(meanings, 1)
    return {"comment": NO_MEAN, **flag_attributes({NOT_COMPUTED: "not_computed", **dict(numbered)})}


def flag_attributes(meanings: Mapping[int, str]) -> dict[str, Any]:
    """Return the CF attributes that list codes (int8, like their variable) and their meanings.

    Examples
    --------
    >>> from pipeline.cubes.cube import flag_attributes
    >>> flag_attributes({1: "open", 2: "closed"})
    {'flag_values': array([1, 2], dtype=int8), 'flag_meanings': 'open closed'}
    """
    codes = np.array(list(meanings), np.int8)
    return {"flag_values": codes, "flag_meanings": " ".join(meanings.values())}


FLAGS = flags(status.name.lower() for status in _STATUSES)
"""Attributes of every variable `status`."""

STATUS_SETTING = {"statuses": FLAGS["flag_meanings"].split()[1:]}
"""The meanings of the codes, as a setting, because they also determine the stored numbers."""


def status_code(status: Status) -> int:
    """Return the code of a Status in cubes; FLAGS lists all codes.

    Examples
    --------
    >>> from nasm.results import Status
    >>> from pipeline.cubes.cube import status_code
    >>> status_code(Status.OK)
    1
    """
    return 1 + _STATUSES.index(status)


def field_arrays(answers: Sequence[Any] | np.ndarray, names: Mapping[str, str]) -> Arrays:
    """Collect the fields of answers into arrays.

    Parameters
    ----------
    answers : nested lists
        The result of a method for each cell, e.g. a CriticalScale, with a field `status`.
    names : mapping of str to str
        Name of the field that fills each variable.

    Returns
    -------
    dict of str to ndarray
        {variable: array of its field}, and the codes of `status`, with the shape of `answers`.
    """
    table = np.array(answers, dtype=object)
    arrays = {name: np.vectorize(attrgetter(f), "d")(table) for name, f in names.items()}
    return arrays | {"status": codes(table, lambda answer: status_code(answer.status))}


def codes(answers: ArrayLike, code_of: Callable[[Any], int]) -> NDArray[np.int8]:
    """Return the codes of all answers as an array; `answers` are nested lists, or an array."""
    return np.vectorize(code_of, "b")(np.array(answers, dtype=object))
