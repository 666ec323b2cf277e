"""Proved statements about forcings, and the certificates of the proofs, one file per tile.

The cube `proved_barrier` contains proved bounds on rays. `proved_map` contains a quadtree of cells
of the (κ1, κ2) plane in which transport is global. `proved_triangles` contains one triangle per
tile, with a corner at κ = 0, in which a barrier exists. See nasm/proofs/README.md.
"""

import json
import lzma
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from io import BytesIO, TextIOWrapper
from typing import Any, TypeAlias

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from nasm import periodic, proofs
from nasm.numbers import parse
from nasm.planes import TWO_KICKS_AXES, Plane, plane_of
from pipeline.cubes.barrier import circle_arrays, job_of_barriers, with_circles
from pipeline.cubes.breakdown import scale_arrays
from pipeline.cubes.cube import (
    NOT_COMPUTED,
    Arrays,
    Coords,
    Cube,
    Job,
    Settings,
    blank,
    coordinate,
    flag_attributes,
)
from pipeline.cubes.warm_up import load_orbits

Certificate: TypeAlias = dict[str, Any]
"""A JSON object, see nasm/proofs/README.md; `nasm.proofs.certificate_checker` checks it."""

REACH = 1.125
"""Largest strength of either kick in `proved_map`; CB_gt ends below it."""

_MAX_RATIO = 100  # maximum ratio of unpacked to packed size; at most 27 for certificates
_MAX_WINDOW = 2**26  # bytes of memory for unpacking; files of `pack_certificates` need 2**19
_BLOCKS = 36  # tiles along an axis of a map
_CORNERS = "kappa1_low", "kappa2_low", "kappa1_high", "kappa2_high"  # far corners of a triangle
_STATES = {
    NOT_COMPUTED: "not_computed",
    proofs.cells.OPEN: "open",
    proofs.cells.TRANSPORT: "transport_is_global",
}
_PROVED = {
    "proved_below": "scale up to which a barrier is proved to exist on all the ray",
    "proved_lower": "scale at which a barrier is proved to exist; it says nothing of smaller ones",
    "proved_upper": "scale at which transport is proved to be global",
}


def proved_barrier(plane: Plane, angles: ArrayLike, seconds: float) -> Job:
    """Return the Job of the cube `proved_barrier`: last barriers, and proved bounds on each ray.

    Parameters
    ----------
    plane : Plane
        The plane of forcings; its origin must be zero.
    angles : array_like
        Directions of rays, in degrees, as for `barrier.last_barrier`.
    seconds : float
        CPU time for each proof on each ray; see `nasm.proofs`. The bounds depend on the speed of
        the machine, but each of them is valid.

    Examples
    --------
    >>> from nasm.planes import two_kicks
    >>> from pipeline.cubes.proved import proved_barrier
    >>> job = proved_barrier(two_kicks(), [10.0, 80.0], seconds=8.0)
    >>> [name for name in job.cube.computed if name.startswith("proved")]
    ['proved_below', 'proved_lower', 'proved_upper']
    """
    plane.rays_start_at_zero("a proof")
    settings, quick = {"tol": 1e-4, "seconds": seconds}, plane.record | {"seconds": 0.1}
    warm_up = partial(_compute_rays, {"angle": np.zeros(1)}, quick)
    cpu_seconds = 1 + 3 * seconds
    return job_of_barriers(
        "proved_barrier", plane, angles, cpu_seconds, settings, _compute_rays, warm_up, _PROVED
    )


def _compute_rays(coords: Coords, settings: Settings) -> Arrays:
    """Prove bounds on the rays of a tile."""
    plane = plane_of(settings)
    profiles = plane.ray(coords["angle"])[1]
    brackets = [proofs.critical_scale(profile, settings["seconds"]) for profile in profiles]
    searched = [bracket.estimate for bracket in brackets]
    arrays = scale_arrays(searched, plane.axes, coords["angle"]) | circle_arrays(searched)
    for key in _PROVED:
        side = key.removeprefix("proved_")
        arrays[key] = np.array([getattr(bracket, side) for bracket in brackets])
    return arrays | pack_certificates(
        proof for b in brackets for proof in (b.barrier, b.transport, *b.below_proofs)
    )


def uncertified_rays(tile: xr.Dataset, certificates: Iterable[Certificate]) -> str:
    """Return a message about a bound on a ray that lacks a certificate; "" if no bound does."""
    claims: set[tuple[str | None, tuple[float, ...]]] = set()
    rays: dict[tuple[float, ...], list[tuple[float, ...]]] = {}
    for certificate in certificates:
        kappa = floats_of(certificate["shortened_from"], "kappa")
        if "scales" in certificate:
            rays.setdefault(kappa, []).append(floats_of(certificate, "scales"))
        else:
            claims.add((certificate["shortened_from"].get("omega"), kappa))
    tile = with_circles(tile)
    for i, profile in enumerate(plane_of(tile.attrs).ray(tile.angle.values)[1]):
        ray, place = tile.isel(angle=i), f"at {float(tile.angle[i]):g} degrees"
        if float(ray.proved_below) > proofs.covered_up_to(rays.get(tuple(profile.tolist()), [])):
            return f"proved_below {place} has no certificates"
        for side, omega in (("proved_lower", ray.circle.item()), ("proved_upper", None)):
            scale = float(ray[side])
            if scale > 0 and (omega, tuple((scale * profile).tolist())) not in claims:
                return f"{side} {place} has no certificate"
    return ""


def proved_map(rays: Sequence[Sequence[float]], cells: int, seconds: float) -> Job:
    """Return the Job of the cube `proved_map`: cells of forcings with global transport.

    Tiles with κ2 > κ1 are not computed: they are images of the others (arXiv:1606.04824, Sec. III).

    Parameters
    ----------
    rays : sequence of (angle, scale)
        Angles in degrees, from 0 to 45, and the scale of the last breakup at each angle; proofs are
        tried near these points.
    cells : int
        Number of cells per unit of κ at the finest level: 32 times a power of two.
    seconds : float
        Limit on the CPU time for the proof of each cell.

    Examples
    --------
    >>> from pipeline.cubes.proved import proved_map
    >>> job = proved_map([(0.0, 1.0), (45.0, 1.2)], cells=64, seconds=1.0)
    >>> dict(job.cube.template.sizes), job.cube.tile_counts
    ({'kappa2': 72, 'kappa1': 72}, (36, 36))
    """
    n = round(REACH * cells)
    axes = {
        name: coordinate(name, (np.arange(n) + 0.5) / cells, TWO_KICKS_AXES[name])
        for name in ("kappa2", "kappa1")
    }
    flags = flag_attributes(_STATES) | {"references": "nasm/proofs/README.md"}
    proved = blank(axes, "what is proved for all forcings of the cell", np.int8(0), **flags)
    title = "Forcings for which transport is proved to be global"
    template = xr.Dataset({"proved": proved}, axes, {"title": title})
    settings = {"rays": rays, "cells": cells, "seconds": seconds}
    cube = Cube("proved_map", template, dict.fromkeys(axes, n // _BLOCKS), settings)
    warm_up = partial(proofs.transport_cells.prove_cell, (1.0, 0.5), 2.0**-8)
    return Job(cube, _compute_cells, _predict_cells, warm_up)


def _compute_cells(coords: Coords, settings: Settings) -> Arrays:
    """Prove that transport is global in cells of a tile."""
    n, size = coords["kappa1"].size, 1 / settings["cells"]
    low1, low2 = (round(coords[name][0] - size / 2, 9) for name in ("kappa1", "kappa2"))
    if low2 > low1:
        return {"proved": np.full((n, n), NOT_COMPUTED, np.int8)}
    depth = n.bit_length() - 1
    proved, cell_proofs = proofs.proved_cells(
        (low1, low2), n * size, depth, settings["rays"], settings["seconds"]
    )
    if low1 == low2:  # cells on one side of the diagonal are images of those on the other
        proved = np.where(np.tri(n, dtype=bool), proved.T, proved)
    return {"proved": proved} | pack_certificates(cell_proofs)


def uncertified_cells(tile: xr.Dataset, certificates: Iterable[Certificate]) -> str:
    """Return a message about proved cells that no certificate covers; "" if all are covered.

    A cell beyond the diagonal is proved by the certificate of its image, with κ1 and κ2 exchanged.
    """
    kappa1, kappa2 = np.meshgrid(tile.kappa1, tile.kappa2)
    certified, half = np.zeros(kappa1.shape, bool), 0.5 / tile.attrs["cells"]
    for certificate in certificates:
        (k1, k2), (h1, h2) = (floats_of(certificate, f) for f in ("kappa", "half_width"))
        for first, second in ((kappa1, kappa2), (kappa2, kappa1)):
            certified |= (np.abs(first - k1) + half <= h1) & (np.abs(second - k2) + half <= h2)
    proved = (tile.proved == proofs.cells.TRANSPORT).values
    n = np.count_nonzero(proved & ~certified)
    return f"proved cells that no certificate covers: {n}" if n else ""


def _predict_cells(coords: Coords, settings: Settings) -> float:
    """Predict CPU seconds: a twentieth of the limit per cell of the finest level near CB_gt."""
    kappa1, kappa2 = np.meshgrid(coords["kappa1"], coords["kappa2"])
    distance = proofs.cells.distance(settings["rays"], kappa1, kappa2)
    size = 1 / settings["cells"]
    is_tried = (distance < size) & (distance > -0.012 - size) & (kappa2 <= kappa1)
    return 0.01 + 0.05 * settings["seconds"] * np.count_nonzero(is_tried)


def proved_triangles(
    rays: Sequence[Sequence[float]], circles: Sequence[str], nearest: float
) -> Job:
    """Return the Job of the cube `proved_triangles`: triangles of forcings with a barrier.

    Parameters
    ----------
    rays : sequence of (angle, scale)
        As for `proved_map`.
    circles : sequence of str
        ω of the last circle on each ray, as a string; "" where it is unknown.
    nearest : float
        Target distance between proofs and boundary, relative to the critical scale; at most 0.5.
    """
    angles, scales = map(np.array, zip(*rays, strict=True))
    triangles = proofs.triangles(angles, scales, circles, nearest / 4)
    axes = {"triangle": coordinate("triangle", np.arange(len(triangles)), "from the axis on")}
    long_name = "part of the way to the far side up to which a barrier is proved to exist"
    variables = {"proved_below": blank(axes, long_name, references="nasm/proofs/README.md")}
    for name in _CORNERS:
        variables[name] = blank(axes, f"{name} of the triangle's corners")
    title = "Triangles of forcings, the first corner being 0, in which a barrier is proved to exist"
    template = xr.Dataset(variables, axes, {"title": title})
    settings = {"triangles": triangles, "nearest": nearest}
    cube = Cube("proved_triangles", template, {"triangle": 1}, settings)
    return Job(cube, _compute_triangle, lambda *_: 2 * _seconds(nearest), _load_triangles)


def _load_triangles() -> None:
    """Compile the kernels of `_compute_triangle`."""
    load_orbits()
    proofs.proved_below("gamma", (0.5, 0.1), 1.0, 1e-3, (0.0, 0.1))


def _seconds(nearest: float) -> float:
    """Estimate the CPU seconds that a triangle takes; those next to a cusp take longer."""
    return 1 + 7 * (0.1 / nearest) ** 1.95


def _compute_triangle(coords: Coords, settings: Settings) -> Arrays:
    """Prove that a barrier exists in the triangle of a tile."""
    (triangle,) = coords["triangle"]
    low, high, circles = settings["triangles"][triangle]
    middle, tilt = np.add(high, low) / 2, np.subtract(high, low) / 2
    proved: list[proofs.BarrierProof] = []
    scale, value = 0.0, 0.0
    for omega in (parse(text) for text in circles if text):
        across = [middle + t * tilt for t in np.linspace(-1, 1, 7)]
        least = min(periodic.critical_scale(omega, kappa).value for kappa in across)
        if least > value:
            circle, value = omega, least
    if value > 0:
        distance = 0.68 * settings["nearest"]  # the last proof may end a tenth short of this
        budget = 4 * _seconds(settings["nearest"])  # a busy machine may take twice as long
        scale, proved = proofs.proved_below(circle, middle, value, budget, tilt, distance)
    corners = dict(zip(_CORNERS, np.array([*low, *high])[:, None], strict=True))
    return corners | {"proved_below": np.array([scale])} | pack_certificates(proved)


def uncertified_triangle(tile: xr.Dataset, certificates: Iterable[Certificate]) -> str:
    """Return a message if the certificates do not reach `proved_below`; "" if they do."""
    tile, intervals = tile.load().isel(triangle=0), []
    low, high = np.reshape([tile[name] for name in _CORNERS], (2, 2))
    for certificate in certificates:
        kappa, tilt, scales = (floats_of(certificate, f) for f in ("kappa", "tilt", "scales"))
        if kappa == tuple((low + high) / 2) and tilt == tuple((high - low) / 2):
            intervals.append(scales)
    if float(tile.proved_below) > proofs.covered_up_to(intervals):
        return f"triangle {int(tile.triangle)} has no certificates to where it is called proved"
    return ""


def pack_certificates(proofs: Iterable[Any]) -> dict[str, bytes]:
    """Return what a tile stores besides its arrays: the certificates of its proofs, compressed.

    Failed proofs and None are omitted; the result is {} if no proof remains. Certificates are
    written to the compressed file one by one, because those of cells take much memory.
    """
    proved, data = [proof for proof in proofs if proof and proof.proved], BytesIO()
    if not proved:
        return {}
    with TextIOWrapper(lzma.open(data, "wb", preset=0), "ascii") as file:
        for i, proof in enumerate(proved):
            file.write(("," if i else "[") + json.dumps(proof.certificate()))
        file.write("]")
    return {"certificates": data.getvalue()}


def unpack_certificates(data: bytes) -> list[Certificate]:
    """Return the list of certificates in the bytes that `pack_certificates` produced.

    Raises
    ------
    ValueError
        If the bytes are damaged, or unpack to more than 100 times their size.

    Examples
    --------
    >>> import lzma
    >>> from pipeline.cubes.proved import unpack_certificates
    >>> unpack_certificates(lzma.compress(b'[{"omega": "gamma"}]'))
    [{'omega': 'gamma'}]
    """
    if not data:
        return []
    unpacker = lzma.LZMADecompressor(memlimit=_MAX_WINDOW)
    try:
        text = unpacker.decompress(data, _MAX_RATIO * len(data))
        if not unpacker.eof:
            raise ValueError(f"they are cut, or unpack to more than {_MAX_RATIO} times their size")
        certificates = json.loads(text)
    except (lzma.LZMAError, EOFError, RecursionError) as error:
        raise ValueError(str(error)) from None
    except MemoryError:
        raise ValueError("there is not enough memory to read them") from None
    is_list = isinstance(certificates, list)
    if not is_list or not all(isinstance(item, dict) for item in certificates):
        raise ValueError("they are not a list of objects")
    return certificates


def floats_of(certificate: Mapping[str, Any], field: str) -> tuple[float, ...]:
    """Return the hexadecimal numbers in a field of a certificate as floats."""
    return tuple(map(float.fromhex, certificate[field]))


def seconds_to_check(certificate: Certificate) -> float:
    """Estimate the CPU seconds that the certificate checker will take.

    Raises
    ------
    ValueError, LookupError, TypeError, AttributeError
        If the certificate is malformed; it should then not be checked.
    """
    if "lives" in certificate:
        lifetimes = certificate["lives"]
        # Each box has two lifetimes, forwards and backwards, or one for both directions.
        numbers = [n for each in lifetimes for n in (each if isinstance(each, list) else [each])]
        if not all(type(n) is int and n > 0 for n in numbers):
            raise ValueError("a box has a lifetime that is not an integer of 1 or more")
        return 7e-5 * sum(numbers)
    degrees = certificate["moves"]["numbers"]
    functions = [function for across in degrees for each in across for function in each]
    size = max(len(part) for function in functions for part in function)
    across, n_kicks = max(map(len, degrees)), len(certificate["kappa"])
    nodes = len(degrees) * (across + 1 if across > 1 else 1)
    inverses = 240 if across > 1 else 30 if "scales" in certificate else 4
    return 1e-4 * n_kicks * size * (nodes + inverses)
