"""Sweeps that evaluate a user's own function over a plane of forcings."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from nasm.planes import Plane, plane_of
from nasm.types import FloatArray
from pipeline.cubes.cube import Arrays, Coords, Cube, Job, Labels, Settings, blank
from pipeline.provenance import ByValue, code_of


def over_plane(
    name: str,
    function: Callable[[FloatArray], Any],
    variables: Mapping[str, str],
    plane: Plane,
    coords: Labels,
    tile: int,
    seconds: float,
) -> Job:
    """Return the Job that evaluates a function over a plane; dims are (second axis, first axis).

    Parameters
    ----------
    name : str
        Name of the cube.
    function : callable
        Function that maps κ, of shape (P,), to one number for each variable.
    variables : mapping of str to str
        Name and description of each variable.
    plane : Plane
        The plane of forcings.
    coords : dict of str to xr.Variable
        Coordinates along the plane's axes; see `escape.axes_of_plane`.
    tile : int
        Cells along each side of a tile.
    seconds : float
        CPU seconds per forcing.
    """
    sent = ByValue(function)
    code = code_of(sent)
    name_of_function = getattr(function, "__qualname__", type(function).__name__)
    settings = plane.record | {"function": f"{name_of_function} {code.own}".strip()}
    fields = {key: blank(coords, text) for key, text in variables.items()}
    template = xr.Dataset(fields, coords, {"title": f"{name_of_function} over {plane.name}"})
    tiles = dict.fromkeys(list(plane.axes)[::-1], tile)
    cube = Cube(name, template, tiles, settings)
    compute = partial(_compute, sent, [*variables])
    return Job(cube, compute, partial(_predict, seconds), partial(_warm_up, sent, plane))


def _compute(
    function: Callable[[FloatArray], Any], names: list[str], coords: Coords, settings: Settings
) -> Arrays:
    """Evaluate the function in the cells of a tile."""
    plane = plane_of(settings)
    forcings = plane.forcing(*np.meshgrid(*(coords[name] for name in plane.axes)))
    values = np.empty((len(names), *forcings.shape[:-1]))
    for cell in np.ndindex(values.shape[1:]):
        answer = function(forcings[cell])
        numbers = np.asarray(answer, dtype=float).ravel()
        if numbers.size != len(names):
            raise ValueError(
                f"the function returned {answer!r:.80} for kappa={forcings[cell].tolist()}; it "
                f"must return one number for each of {', '.join(names)}"
            )
        values[:, *cell] = numbers
    return dict(zip(names, values, strict=True))


def _predict(seconds: float, coords: Coords, settings: Settings) -> float:
    """Predict CPU seconds from the number of cells."""
    return seconds * float(np.prod([coords[name].size for name in plane_of(settings).axes]))


def _warm_up(function: Callable[[FloatArray], Any], plane: Plane) -> None:
    """Call the function once, so that compilation does not count towards the time of a tile."""
    with suppress(Exception):  # computing a tile will report the same error
        function(plane.forcing(0.1, 0.1))
