"""Proved statements about forcings, and the certificates of the proofs, one file per tile.

The cube `proved_barrier` contains proved bounds on rays. `proved_map` marks the cells of a plane in
which transport is proved to be global. `proved_triangles` contains one triangle per tile, with a
corner at the plane's origin, in which a barrier is proved to exist. The function `proved_forcings`
builds cubes of results proved for individual forcings. See nasm/proofs/README.md.
"""

import json
import lzma
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from io import BytesIO, TextIOWrapper
from math import ceil, prod
from typing import Any, TypeAlias

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from nasm import periodic, proofs, symmetries
from nasm.circles import hull
from nasm.numbers import parse
from nasm.planes import TWO_KICKS_AXES, Plane, plane_of, three_kicks, two_kicks
from nasm.proofs.certificates import matrix_in_hex
from nasm.types import FloatArray
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
    text,
)
from pipeline.cubes.warm_up import load_orbits

Certificate: TypeAlias = dict[str, Any]
"""A JSON object, see nasm/proofs/README.md; `nasm.proofs.certificate_checker` checks it."""

BARRIER = 3
"""Code of a forcing under which a barrier is proved to exist; cells have the codes 1 and 2."""

_MAX_SECONDS = 60.0
"""CPU time for a proof about a single forcing. Proving a barrier 0.3% below CB_gt takes 2 to 3
seconds, and proving transport beyond CB_gt takes a hundredth of a second."""

_MAX_RATIO = 100  # maximum ratio of unpacked to packed size; at most 27 for certificates
_MAX_WINDOW = 2**26  # bytes of memory for unpacking; files from `pack_certificates` need 2**19
_BLOCKS = 36  # number of tiles along an axis of a map; fewer if cells are coarse
_MARGIN, _STEP = 1.15, 8  # factor by which a map exceeds CB_gt; its reach is a multiple of 1/_STEP
_BLOCK_CELLS = 2**18  # cells that are unfolded together
_SWAP = True, 90  # the symmetry that exchanges the coordinates of a plane
_STATES = {
    NOT_COMPUTED: "not_computed",
    proofs.cells.OPEN: "open",
    proofs.cells.TRANSPORT: "transport_is_global",
}
_ANSWERS = {
    NOT_COMPUTED: "not_computed",
    proofs.cells.OPEN: "open",
    proofs.cells.TRANSPORT: "transport_is_global",
    BARRIER: "a_barrier_exists",
}
_PROVED = {
    "proved_below": "a barrier is proved to exist at every scale up to this one",
    "proved_lower": "scale at which a barrier is proved to exist; smaller scales are not covered",
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
        the machine, but are valid on any machine.

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
    """Return a message about a bound on a ray that lacks a certificate; "" if all have one."""
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
            return f"the certificates {place} do not reach proved_below"
        for side, omega in (("proved_lower", ray.circle.item()), ("proved_upper", None)):
            scale = float(ray[side])
            if scale > 0 and (omega, tuple((scale * profile).tolist())) not in claims:
                return f"{side} {place} has no certificate"
    return ""


def proved_map(plane: Plane, rays: Sequence[Sequence[float]], cells: int, seconds: float) -> Job:
    """Return the Job of the cube `proved_map`: cells of forcings with global transport.

    Tiles outside the plane's fundamental domain, `wedge` (for two kicks, the tiles with κ2 > κ1),
    are not computed, because they are images of tiles inside it (arXiv:1606.04824, Sec. III).
    `everywhere` adds the images.

    Parameters
    ----------
    plane : Plane
        The plane of forcings.
    rays : sequence of (angle, scale)
        Angles in degrees, in the plane's `wedge`, and the scale of the last breakup at each angle;
        proofs are attempted near these points, and the map extends somewhat beyond them.
    cells : int
        Number of cells per unit of strength at the finest level, a power of two; 8 or more.
    seconds : float
        Limit on the CPU time of the proof for each cell.

    Examples
    --------
    >>> from nasm.planes import two_kicks
    >>> from pipeline.cubes.proved import proved_map
    >>> job = proved_map(two_kicks(), [(0.0, 0.97), (45.0, 1.2)], cells=64, seconds=1.0)
    >>> dict(job.cube.template.sizes), job.cube.tile_counts
    ({'kappa2': 72, 'kappa1': 72}, (36, 36))
    """
    angles, scales = np.transpose(rays)
    farthest = (scales * np.abs(symmetries.ray(plane.unfold(angles))).max(axis=-1)).max()
    reach = int(np.ceil(_STEP * _MARGIN * farthest)) / _STEP
    # If reflections in both axes are symmetries, the map begins at 0.
    begin = 0.0 if {(True, 0), (True, 180)} <= _elements(plane) else -reach
    width = max(2.0 ** np.floor(np.log2((reach - begin) / _BLOCKS)), 1 / cells)
    at = begin + (np.arange(round((reach - begin) * cells)) + 0.5) / cells
    axes = {name: coordinate(name, at, text) for name, text in reversed(plane.axes.items())}
    flags = flag_attributes(_STATES) | {"references": "nasm/proofs/README.md"}
    proved = blank(axes, "what is proved for all forcings of the cell", np.int8(0), **flags)
    title = "Forcings for which transport is proved to be global"
    template = xr.Dataset({"proved": proved}, axes, {"title": title})
    settings = plane.record | {"rays": rays, "cells": cells, "seconds": seconds}
    cube = Cube("proved_map", template, dict.fromkeys(axes, round(width * cells)), settings)
    warm_up = partial(_load_cells, plane)
    return Job(cube, _compute_cells, _predict_cells, warm_up)


def _load_cells(plane: Plane) -> None:
    """Compile the kernels of `_compute_cells`."""
    proofs.transport_cells.prove_cell((1.0, 0.5), 2.0**-8)
    if plane != two_kicks():
        proofs.transport_cells.prove_cell_of_plane(three_kicks(0.5), (0.75, 0.5), 2.0**-8)


def _compute_cells(coords: Coords, settings: Settings) -> Arrays:
    """Prove that transport is global in cells of a tile."""
    plane, size = plane_of(settings), 1 / settings["cells"]
    name_a, name_b = plane.axes
    n = coords[name_a].size
    a, b = (round(float(coords[name][0] - size / 2), 9) for name in (name_a, name_b))
    if not proofs.cells.in_wedge(plane, a + n * size / 2, b + n * size / 2):
        return {"proved": np.full((n, n), NOT_COMPUTED, np.int8)}
    depth = n.bit_length() - 1
    proved, cell_proofs = proofs.proved_cells(
        plane, (a, b), n * size, depth, settings["rays"], settings["seconds"]
    )
    if a == b and _swaps(plane):  # the mirror image of each cell is in this tile
        proved = np.maximum(proved, proved.T)  # TRANSPORT is larger than OPEN
    return {"proved": proved} | pack_certificates(cell_proofs)


def _elements(plane: Plane) -> set[tuple[bool, int]]:
    """Return a plane's exact symmetries as reflections and rotations (degrees), without shifts."""
    return {(mirrored, turn) for mirrored, turn, _ in plane.exact_symmetries}


def _swaps(plane: Plane) -> bool:
    """Return whether exchanging the coordinates of the plane is a symmetry."""
    return _SWAP in _elements(plane)


def uncertified_cells(tile: xr.Dataset, certificates: Iterable[Certificate]) -> str:
    """Return a message about proved cells that no certificate covers; "" if all are covered.

    If exchanging the coordinates is a symmetry of the plane, a certificate for the image of a cell
    covers the cell, too.
    """
    plane = plane_of(tile.attrs)
    a, b = np.meshgrid(*(tile[name] for name in plane.axes))
    certified, half = np.zeros(a.shape, bool), 0.5 / tile.attrs["cells"]
    images = ((a, b), (b, a)) if _swaps(plane) else ((a, b),)
    for certificate in certificates:
        middle = "centre" if plane != two_kicks() else "kappa"
        if certificate.get("plane") != (matrix_in_hex(plane) if plane != two_kicks() else None):
            continue
        (k1, k2), (h1, h2) = (floats_of(certificate, field) for field in (middle, "half_width"))
        for first, second in images:
            certified |= (np.abs(first - k1) + half <= h1) & (np.abs(second - k2) + half <= h2)
    proved = (tile.proved == proofs.cells.TRANSPORT).values
    n = np.count_nonzero(proved & ~certified)
    return f"proved cells that no certificate covers: {n}" if n else ""


def everywhere(cube: xr.Dataset, barrier: xr.Dataset) -> xr.Dataset:
    """Return the cells of the whole plane, images included.

    Images are formed by the `exact_symmetries` of the plane.

    Parameters
    ----------
    cube : xr.Dataset
        The cube `proved_map`.
    barrier : xr.Dataset
        CB_gt in the plane's `wedge`, as returned by `barrier.unfolded`.

    Returns
    -------
    xr.Dataset, dims (second coordinate, first coordinate)
        `proved` is True where transport is proved; `excess` is the relative distance beyond CB_gt;
        `outside_theorem` is True where the theorem for three kicks or more does not apply.

    Examples
    --------
    >>> from nasm.planes import two_kicks
    >>> from pipeline.cubes.barrier import boundary
    >>> from pipeline.cubes.proved import everywhere, proved_map
    >>> barrier = boundary([0.0, 22.5, 45.0], tol=1e-2)
    >>> cube = proved_map(two_kicks(), [(0.0, 0.97), (45.0, 1.2)], cells=64, seconds=1.0).cube
    >>> whole = everywhere(cube.filled({}).assign_attrs(cube.attributes), barrier)
    >>> dict(whole.sizes), int(whole.proved.sum())
    ({'kappa2': 144, 'kappa1': 144}, 0)
    """
    plane, half = plane_of(cube.attrs), 0.5 / cube.attrs["cells"]
    names = list(plane.axes)
    here = (cube.proved.transpose(*names) == proofs.cells.TRANSPORT).values
    at, first = cube[names[0]].values, float(cube[names[0]][0])
    at = np.concatenate([-at[::-1], at]) if first > 0 else at
    known = barrier.dropna("angle", subset=["critical_scale"])
    rays = list(zip(known.angle.values, known.critical_scale.values, strict=True))
    shape = (at.size, at.size)  # indexed by b and a
    proved, outside = np.zeros(shape, bool), np.empty(shape, bool)
    excess = np.empty(shape, np.float32)
    # Temporary arrays for all cells of a full-size map would take several gigabytes.
    for rows in np.array_split(np.arange(at.size), ceil(at.size**2 / _BLOCK_CELLS)):
        a, b = np.meshgrid(at, at[rows])
        for mirrored, turn, _ in plane.exact_symmetries:
            cos, sin = round(np.cos(np.deg2rad(turn))), round(np.sin(np.deg2rad(turn)))
            c = -b if mirrored else b
            image = np.stack([cos * a - sin * c, sin * a + cos * c])
            index = np.rint((image - first) / (2 * half)).astype(int)
            inside = ((index >= 0) & (index < np.array(here.shape)[:, None, None])).all(axis=0)
            proved[rows] |= inside & here[tuple(index * inside)]
        excess[rows] = -proofs.cells.distance(plane, rays, a, b)
        outside[rows] = outside_theorem(plane, a, b, half)
    variables = {"proved": proved, "excess": excess, "outside_theorem": outside}
    dims = names[::-1]
    arrays = {name: (dims, array) for name, array in variables.items()}
    return xr.Dataset(arrays, dict.fromkeys(names, at), cube.attrs)


def outside_theorem(
    plane: Plane, a: FloatArray, b: FloatArray, half_width: float
) -> NDArray[np.bool_]:
    """Find the cells to which the theorem on transport under several kicks does not apply.

    Rounding is ignored, as the result is used only in captions.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.planes import three_kicks
    >>> from pipeline.cubes.proved import outside_theorem
    >>> outside_theorem(three_kicks(0.2), np.array([1.0, 1.75]), np.array([1.0, 1.75]), 0.01)
    array([False,  True])
    """
    spread = half_width * (np.abs(plane.first) + np.abs(plane.second))
    diagonal = 2 - np.abs(plane.forcing(a, b)) - spread
    applies = np.zeros(a.shape, bool)
    for m in range(diagonal.shape[-1]):
        entries = np.roll(diagonal, -m, axis=-1)[..., 1:]
        minor, last, positive = np.ones(a.shape), np.zeros(a.shape), np.ones(a.shape, bool)
        for entry in np.moveaxis(entries, -1, 0):
            minor, last = entry * minor - last, minor
            positive &= minor > 0
        applies |= positive
    return ~applies


def _predict_cells(coords: Coords, settings: Settings) -> float:
    """Predict CPU seconds: a twentieth of the limit per cell of the finest level near CB_gt.

    In planes other than `two_kicks()`, a cell takes about ten times as long, because a curve of
    starts has to be found first.
    """
    plane, size = plane_of(settings), 1 / settings["cells"]
    a, b = np.meshgrid(*(coords[name] for name in plane.axes))
    if not proofs.cells.in_wedge(plane, a.mean(), b.mean()):
        return 0.01
    distance = proofs.cells.distance(plane, settings["rays"], a, b)
    is_tried = (distance < size) & (distance > -0.012 - size)
    each = 0.05 if plane == two_kicks() else 0.5
    return 0.01 + each * settings["seconds"] * np.count_nonzero(is_tried)


def proved_triangles(
    plane: Plane, rays: Sequence[Sequence[float]], circles: Sequence[str], nearest: float
) -> Job:
    """Return the Job of the cube `proved_triangles`: triangles of forcings with a barrier.

    Parameters
    ----------
    plane, rays
        As for `proved_map`.
    circles : sequence of str
        ω of the last circle on each ray, as a string; "" where it is unknown.
    nearest : float
        Target distance between proofs and boundary, relative to the critical scale; at most 0.5.
    """
    angles, scales = map(np.array, zip(*rays, strict=True))
    triangles = proofs.triangles(angles, scales, circles, nearest / 4)
    axes = {"triangle": coordinate("triangle", np.arange(len(triangles)), "in order of angle")}
    long_name = "fraction of the way to the far side up to which a barrier is proved to exist"
    variables = {"proved_below": blank(axes, long_name, references="nasm/proofs/README.md")}
    for name in corner_names(plane):
        variables[name] = blank(axes, f"{name}, coordinate of a far corner of the triangle")
    title = (
        "Triangles of forcings with a corner at the plane's origin, in which a barrier is "
        "proved to exist"
    )
    template = xr.Dataset(variables, axes, {"title": title})
    settings = plane.record | {"triangles": triangles, "nearest": nearest}
    cube = Cube("proved_triangles", template, {"triangle": 1}, settings)
    seconds = _seconds(plane, nearest)
    return Job(cube, _compute_triangle, lambda *_: seconds, _load_triangles)


def corner_names(plane: Plane) -> list[str]:
    """Return the names of the coordinates of the far corners of a triangle.

    Examples
    --------
    >>> from nasm.planes import two_kicks
    >>> from pipeline.cubes.proved import corner_names
    >>> corner_names(two_kicks())
    ['kappa1_low', 'kappa2_low', 'kappa1_high', 'kappa2_high']
    """
    return [f"{name}_{end}" for end in ("low", "high") for name in plane.axes]


def _load_triangles() -> None:
    """Compile the kernels of `_compute_triangle`."""
    load_orbits()
    proofs.proved_below("gamma", (0.5, 0.1), 1.0, 1e-3, (0.0, 0.1))


def _seconds(plane: Plane, nearest: float) -> float:
    """Estimate the CPU seconds that a triangle takes; triangles near a cusp take longer."""
    return (1 + 6 * (0.1 / nearest) ** 1.35) * (max(len(plane.origin), 2) / 2) ** 2.5


def _compute_triangle(coords: Coords, settings: Settings) -> Arrays:
    """Prove that a barrier exists in the triangle of a tile."""
    (triangle,) = coords["triangle"]
    low, high, circles = settings["triangles"][triangle]
    plane, nearest = plane_of(settings), settings["nearest"]
    middle, tilt = np.add(high, low) / 2, np.subtract(high, low) / 2
    proved: list[proofs.BarrierProof] = []
    scale, value = 0.0, 0.0
    origin = plane.forcing(0.0, 0.0)
    start = origin if origin.any() else None
    for omega in (parse(each) for each in circles if each):
        across = [plane.forcing(*(middle + t * tilt)) - origin for t in np.linspace(-1, 1, 7)]
        least = min(periodic.critical_scale(omega, k, start=start).value for k in across)
        if least > value:
            circle, value = omega, least
    if value > 0:
        distance = 0.68 * nearest  # the last proof may stop up to a tenth further away
        budget = 4 * _seconds(plane, nearest)  # a busy machine may take twice as long
        within = None if plane == two_kicks() else plane
        scale, proved = proofs.proved_below(circle, middle, value, budget, tilt, distance, within)
    corners = dict(zip(corner_names(plane), np.array([*low, *high])[:, None], strict=True))
    return corners | {"proved_below": np.array([scale])} | pack_certificates(proved)


def uncertified_triangle(tile: xr.Dataset, certificates: Iterable[Certificate]) -> str:
    """Return a message if the certificates do not reach `proved_below`; "" if they do."""
    tile, intervals = tile.load().isel(triangle=0), []
    plane = plane_of(tile.attrs)
    matrix = None if plane == two_kicks() else matrix_in_hex(plane)
    low, high = np.reshape([tile[name] for name in corner_names(plane)], (2, 2))
    for certificate in certificates:
        middle = "kappa" if matrix is None else "centre"
        kappa, tilt, scales = (floats_of(certificate, f) for f in (middle, "tilt", "scales"))
        is_here = kappa == tuple((low + high) / 2) and tilt == tuple((high - low) / 2)
        if is_here and certificate.get("plane") == matrix:
            intervals.append(scales)
    if float(tile.proved_below) > proofs.covered_up_to(intervals):
        return f"the certificates of triangle {int(tile.triangle)} do not reach its proved_below"
    return ""


def proved_forcings(
    name: str, forcings: Sequence[tuple[float, float, float]], circles: Sequence[str]
) -> Job:
    """Return the Job of a cube of individual two-kick forcings, with a separate proof for each.

    Parameters
    ----------
    name : str
        Name of the cube.
    forcings : sequence of (kappa1, kappa2, margin)
        Strengths of the two kicks, and the ratio of κ to the forcing at which the last circle
        breaks on its ray, minus 1. Where the margin is positive, a proof of transport is attempted;
        elsewhere, a proof of a barrier.
    circles : sequence of str
        ω of the circle to try, as a string.

    Examples
    --------
    >>> from pipeline.cubes.proved import proved_forcings
    >>> job = proved_forcings("few", [(0.4, 0.0, -0.17), (0.6, 0.0, 0.23)], ["gamma"] * 2)
    >>> job.cube.tile_counts
    (2,)
    """
    kappa1, kappa2, margins = zip(*forcings, strict=True)
    on = {"forcing": coordinate("forcing", np.arange(len(forcings)), "number of the forcing")}
    coords = on | {
        "kappa1": coordinate("forcing", kappa1, TWO_KICKS_AXES["kappa1"]),
        "kappa2": coordinate("forcing", kappa2, TWO_KICKS_AXES["kappa2"]),
        "margin": coordinate("forcing", margins, "relative distance from CB_gt along the ray"),
        "circle": text("forcing", circles, "rotation number of the circle to try"),
    }
    flags = flag_attributes(_ANSWERS) | {"references": "nasm/proofs/README.md"}
    proved = {"proved": blank(on, "what is proved for the forcing", np.int8(0), **flags)}
    template = xr.Dataset(proved, coords, {"title": "Forcings with individual proofs"})
    cube = Cube(name, template, {"forcing": 1}, {"seconds": _MAX_SECONDS})
    return Job(cube, _compute_forcing, _predict_forcing, _load_forcing)


def _load_forcing() -> None:
    """Compile the kernels of `_compute_forcing`."""
    load_orbits()
    for margin in 0.4, -0.4:
        row = {"kappa1": 0.4858 * (1 + margin), "kappa2": 0.0, "margin": margin, "circle": "gamma"}
        _compute_forcing({key: np.array([value]) for key, value in row.items()}, {"seconds": 5.0})


def _predict_forcing(coords: Coords, settings: Settings) -> float:
    """Predict CPU seconds: 0.6 for a barrier 1% below the breakup, and 0.05 for transport."""
    margins = np.asarray(coords["margin"])
    below = np.maximum(-margins, 1e-4)
    return float(np.where(margins < 0, 0.1 + 0.5 * (0.01 / below) ** 1.3, 0.05).sum())


def _compute_forcing(coords: Coords, settings: Settings) -> Arrays:
    """Prove that transport is global, or that a barrier exists, under the forcing of a tile."""
    kappa = np.array([coords["kappa1"][0], coords["kappa2"][0]])
    margin, seconds = float(coords["margin"][0]), settings["seconds"]
    if margin > 0:
        transport = proofs.transport.prove(kappa, seconds)
        code = proofs.cells.TRANSPORT if transport.proved else proofs.cells.OPEN
        return {"proved": np.array([code], np.int8)} | pack_certificates([transport])
    omega, found = parse(str(coords["circle"][0])), []
    distance = min(max(-margin, 1e-6), 0.5)
    _, start = hull.certified_circle(omega, kappa, 1 / (1 + margin), distance)
    if start is not None:
        found.append(proofs.barrier.prove(omega, kappa, start=start, budget=seconds))
    code = BARRIER if found and found[0].proved else proofs.cells.OPEN
    return {"proved": np.array([code], np.int8)} | pack_certificates(found)


def uncertified_forcing(tile: xr.Dataset, certificates: Iterable[Certificate]) -> str:
    """Return a message if a forcing is marked as proved without a certificate; "" otherwise."""
    tile = tile.load().isel(forcing=0)
    code, kappa = int(tile.proved), (float(tile.kappa1), float(tile.kappa2))
    for certificate in certificates:
        about = certificate["shortened_from"]
        shown = BARRIER if about.get("omega") else proofs.cells.TRANSPORT
        if (shown, floats_of(about, "kappa")) == (code, kappa):
            return ""
    if code in (BARRIER, proofs.cells.TRANSPORT):
        return f"forcing {int(tile.forcing)} is marked as proved but has no certificate"
    return ""


def pack_certificates(proofs: Iterable[Any]) -> dict[str, bytes]:
    """Return what a tile stores besides its arrays: the certificates of its proofs, compressed.

    Failed proofs and None are omitted; the result is {} if no proof remains. Certificates are
    written to the compressed file one by one, because certificates for cells take a lot of memory.
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
            raise ValueError(
                f"they are truncated, or unpack to more than {_MAX_RATIO} times their size"
            )
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
            raise ValueError("a box has a lifetime that is not a positive integer")
        return 5e-5 * sum(numbers)
    degrees = certificate["moves"]["numbers"]
    functions = [function for across in degrees for each in across for function in each]
    size = max(len(part) for function in functions for part in function)
    rows = certificate.get("plane", {"origin": certificate.get("kappa")})
    counts = len(degrees), max(map(len, degrees))
    n_points = prod(count + 2 if count > 1 else 1 for count in counts)
    return 1.4e-4 * len(rows["origin"]) * size * n_points
