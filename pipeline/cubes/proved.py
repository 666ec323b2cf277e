"""What is proved of forcings, and the certificates of it, a file for each tile.

`proved_barrier` has proved bounds on rays, `proved_map` a quadtree of cells of the (κ1, κ2) plane
where transport is global, `proved_triangles` a triangle from κ = 0 on for each tile, in which a
barrier exists. See nasm/proofs/README.md.
"""

import json
import lzma
from functools import partial
from io import BytesIO

import numpy as np
import xarray as xr

from nasm import periodic, proofs
from nasm.numbers import parse
from nasm.planes import TWO_KICKS_AXES, plane_of
from pipeline.cubes.barrier import circle_arrays, job_of_barriers, with_circles
from pipeline.cubes.breakdown import scales
from pipeline.cubes.cube import NOT_COMPUTED, Cube, Job, blank, coordinate

REACH = 1.125  # of both strengths; CB_gt ends before
_MAX_RATIO = 100  # of certificates to their bytes when they are packed; it is 27 at most
_MAX_WINDOW = 2**26  # bytes that unpacking may need besides; those that are packed here need 2**19
_BLOCKS = 36  # along an axis; each is a tile
_CORNERS = "kappa1_low", "kappa2_low", "kappa1_high", "kappa2_high"  # of a triangle
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


def proved_barrier(plane, angles, seconds):
    """Return the Job of the cube `proved_barrier`: `last_barrier`, and what is proved of each ray.

    angles : degrees. seconds : float, CPU time for each proof of each ray; see `nasm.proofs`. The
    proved bounds depend on the machine's speed; each of them holds.
    """
    plane.rays_start_at_zero("a proof")
    settings, quick = {"tol": 1e-4, "seconds": seconds}, plane.record | {"seconds": 0.1}
    warm_up = partial(_compute_rays, {"angle": np.zeros(1)}, quick)
    how = 1 + 3 * seconds, settings, _compute_rays, warm_up, _PROVED
    return job_of_barriers("proved_barrier", plane, angles, *how)


def _compute_rays(coords, settings):
    plane = plane_of(settings)
    profiles = plane.ray(coords["angle"])[1]
    brackets = [proofs.critical_scale(profile, settings["seconds"]) for profile in profiles]
    found = [bracket.found for bracket in brackets]
    arrays = scales(found, plane.axes, coords["angle"]) | circle_arrays(found)
    for key in _PROVED:
        side = key.removeprefix("proved_")
        arrays[key] = np.array([getattr(bracket, side) for bracket in brackets])
    return arrays | packed(proof for b in brackets for proof in (b.barrier, b.transport, *b.rays))


def uncertified_rays(tile, certificates):
    """Say what a tile of `proved_barrier` calls proved without a certificate of it; else ""."""
    claimed, rays = set(), {}
    for certificate in certificates:
        kappa = of_certificate(certificate["shortened_from"], "kappa")
        if "scales" in certificate:
            rays.setdefault(kappa, []).append(of_certificate(certificate, "scales"))
        else:
            claimed.add((certificate["shortened_from"].get("omega"), kappa))
    tile = with_circles(tile)
    for i, profile in enumerate(plane_of(tile.attrs).ray(tile.angle.values)[1]):
        here, at = tile.isel(angle=i), f"at {float(tile.angle[i]):g} degrees"
        if float(here.proved_below) > proofs.covered(rays.get(tuple(profile.tolist()), [])):
            return f"proved_below {at} has no certificates"
        for side, omega in (("proved_lower", here.circle.item()), ("proved_upper", None)):
            scale = float(here[side])
            if scale > 0 and (omega, tuple((scale * profile).tolist())) not in claimed:
                return f"{side} {at} has no certificate"
    return ""


def proved_map(rays, cells, seconds):
    """Return the Job of the cube `proved_map`. Tiles of κ2 > κ1 are not computed: they are images
    (arXiv:1606.04824, Sec. III).

    rays : list of (angle in degrees, scale of the last breakup) from 0 to 45 degrees. They tell
    where to try. cells : finest cells per unit of κ, 16 times a power of two. seconds : CPU time
    for a cell's proof.
    """
    n = round(REACH * cells)
    axes = {
        name: coordinate(name, (np.arange(n) + 0.5) / cells, TWO_KICKS_AXES[name])
        for name in ("kappa2", "kappa1")
    }
    flags = {"flag_values": list(_STATES), "flag_meanings": " ".join(_STATES.values())}
    words = "what is proved for all forcings of the cell"
    proved = blank(axes, words, np.int8(0), **flags, source="nasm/proofs/README.md")
    title = "Forcings for which transport is proved to be global"
    template = xr.Dataset({"proved": proved}, axes, {"title": title})
    settings = {"rays": rays, "cells": cells, "seconds": seconds}
    cube = Cube("proved_map", template, dict.fromkeys(axes, n // _BLOCKS), settings)
    warm_up = partial(proofs.transport_cells.prove_cell, (1.0, 0.5), 2.0**-8)
    return Job(cube, _compute_cells, _predict_cells, warm_up)


def _compute_cells(coords, settings):
    n, size = coords["kappa1"].size, 1 / settings["cells"]
    low1, low2 = (round(coords[name][0] - size / 2, 9) for name in ("kappa1", "kappa2"))
    if low2 > low1:
        return {"proved": np.full((n, n), NOT_COMPUTED, np.int8)}
    where = (low1, low2), n * size, n.bit_length() - 1
    proved, found = proofs.proved_cells(*where, settings["rays"], settings["seconds"])
    if low1 == low2:  # the other side of the diagonal is its image
        proved = np.where(np.tri(n, dtype=bool), proved.T, proved)
    return {"proved": proved} | packed(found)


def uncertified_cells(tile, certificates):
    """Say what a tile of the cube calls proved without a certificate that claims it; else "".

    A cell beyond the diagonal is proved by the certificate of its image, κ1 and κ2 exchanged.
    """
    kappa1, kappa2 = np.meshgrid(tile.kappa1, tile.kappa2)
    found, half = np.zeros(kappa1.shape, bool), 0.5 / tile.attrs["cells"]
    for certificate in certificates:
        (k1, k2), (h1, h2) = (of_certificate(certificate, f) for f in ("kappa", "half_width"))
        for first, second in ((kappa1, kappa2), (kappa2, kappa1)):
            found |= (np.abs(first - k1) + half <= h1) & (np.abs(second - k2) + half <= h2)
    proved = (tile.proved == proofs.cells.TRANSPORT).values
    n = np.count_nonzero(proved & ~found)
    return f"{n} cells are called proved, and no certificate claims it" if n else ""


def _predict_cells(coords, settings):
    """A twentieth of the time for each finest cell near CB_gt."""
    kappa1, kappa2 = np.meshgrid(coords["kappa1"], coords["kappa2"])
    distance = proofs.cells.distance(settings["rays"], kappa1, kappa2)
    size = 1 / settings["cells"]
    near = (distance < size) & (distance > -0.012 - size) & (kappa2 <= kappa1)
    return 0.01 + 0.05 * settings["seconds"] * np.count_nonzero(near)


def proved_triangles(rays, circles, nearest):
    """Return the Job of the cube `proved_triangles`.

    rays : as of `proved_map`. circles : texts of the last circles' ω on them, "" where unknown.
    nearest : how near proofs come to the boundary, in parts of it; at most 0.5.
    """
    angles, scales = map(np.array, zip(*rays, strict=True))
    found = proofs.triangles(angles, scales, circles, nearest / 4)
    axes = {"triangle": coordinate("triangle", np.arange(len(found)), "from the axis on")}
    words = "a barrier is proved to exist in the triangle to this part of the way to its far side"
    variables = {"proved_below": blank(axes, words, source="nasm/proofs/README.md")}
    for name in _CORNERS:
        variables[name] = blank(axes, f"{name} of the triangle's corners")
    title = "Triangles of forcings, the first corner being 0, in which a barrier is proved to exist"
    template = xr.Dataset(variables, axes, {"title": title})
    settings = {"triangles": found, "nearest": nearest}
    cube = Cube("proved_triangles", template, {"triangle": 1}, settings)
    warm_up = partial(proofs.proved_below, "gamma", (0.5, 0.1), 1.0, 1e-3, (0.0, 0.1))
    return Job(cube, _compute_triangle, lambda *_: _seconds(nearest), warm_up)


def _seconds(nearest):
    """What a triangle takes, about, but for those next to a cusp, where more is tried."""
    return 1 + 7 * (0.1 / nearest) ** 1.95


def _compute_triangle(coords, settings):
    (triangle,) = coords["triangle"]
    low, high, circles = settings["triangles"][triangle]
    middle, tilt = np.add(high, low) / 2, np.subtract(high, low) / 2
    scale, proved, value = 0.0, [], 0.0
    for omega in (parse(text) for text in circles if text):
        across = [middle + t * tilt for t in np.linspace(-1, 1, 7)]
        least = min(periodic.critical_scale(omega, kappa).value for kappa in across)
        if least > value:
            circle, value = omega, least
    if value > 0:
        near = 0.68 * settings["nearest"]  # the last step may end a tenth before
        budget = 4 * _seconds(settings["nearest"])  # a busy machine takes twice as long
        scale, proved = proofs.proved_below(circle, middle, value, budget, tilt, near)
    found = dict(zip(_CORNERS, np.array([*low, *high])[:, None], strict=True))
    return found | {"proved_below": np.array([scale])} | packed(proved)


def uncertified_triangle(tile, certificates):
    """Say that a triangle has no certificates to where it is called proved; else ""."""
    tile, found = tile.load().isel(triangle=0), []
    low, high = np.reshape([tile[name] for name in _CORNERS], (2, 2))
    for certificate in certificates:
        kappa, tilt, scales = (of_certificate(certificate, f) for f in ("kappa", "tilt", "scales"))
        if kappa == tuple((low + high) / 2) and tilt == tuple((high - low) / 2):
            found.append(scales)
    if float(tile.proved_below) > proofs.covered(found):
        return f"triangle {int(tile.triangle)} has no certificates to where it is called proved"
    return ""


def packed(proofs):
    """Return what a tile keeps beside its arrays: the certificates of those that are proved.

    They are compressed one by one, as those of cells take much memory.
    """
    proved, data = [proof for proof in proofs if proof and proof.proved], BytesIO()
    if not proved:
        return {}
    with lzma.open(data, "wt", preset=0) as file:
        for i, proof in enumerate(proved):
            file.write(("," if i else "[") + json.dumps(proof.certificate()))
        file.write("]")
    return {"certificates": data.getvalue()}


def unpacked(data):
    """Return the list of certificates, objects all; ValueError if the bytes are damaged, or are
    more than `_MAX_RATIO` times as many when they are unpacked."""
    if not data:
        return []
    unpacker = lzma.LZMADecompressor(memlimit=_MAX_WINDOW)
    try:
        text = unpacker.decompress(data, _MAX_RATIO * len(data))
        if not unpacker.eof:
            raise ValueError(f"they are cut, or unpack to more than {_MAX_RATIO} times their size")
        found = json.loads(text)
    except (lzma.LZMAError, EOFError, RecursionError) as error:
        raise ValueError(str(error)) from None
    except MemoryError:
        raise ValueError("there is not enough memory to read them") from None
    if not (isinstance(found, list) and all(isinstance(item, dict) for item in found)):
        raise ValueError("they are no list of objects")
    return found


def of_certificate(certificate, field):
    """Return a row of numbers in a certificate as a tuple of floats."""
    return tuple(map(float.fromhex, certificate[field]))


def seconds_to_check(certificate):
    """Return the CPU seconds, about, that the checker will take; ValueError, or another error of
    what is malformed, if that cannot be told, as nothing should be checked then."""
    if "lives" in certificate:
        lives = certificate["lives"]
        # Forwards and backwards of each box, or for both at once.
        numbers = [n for each in lives for n in (each if isinstance(each, list) else [each])]
        if not all(type(n) is int and n > 0 for n in numbers):
            raise ValueError("a box has a lifetime that is no whole number of 1 or more")
        return 7e-5 * sum(numbers)
    degrees = certificate["moves"]["numbers"]
    functions = [function for across in degrees for each in across for function in each]
    size = max(len(part) for function in functions for part in function)
    across, n_kicks = max(map(len, degrees)), len(certificate["kappa"])
    nodes = len(degrees) * (across + 1 if across > 1 else 1)
    inverses = 240 if across > 1 else 30 if "scales" in certificate else 4
    return 1e-4 * n_kicks * size * (nodes + inverses)
