"""The last barrier on rays: CB_gt from both sides, and which circle is the last.

On rays of a plane of forcings, arXiv:1606.04824, Sec. V and VI. CB_gt has the symmetries of its
plane (Sec. III and `nasm.planes`), so that the rays computed stand for their images too.
"""

import re
from functools import partial

import numpy as np

from nasm import barriers
from nasm.numbers import RotationNumber, moebius, parse
from nasm.planes import plane_of, two_kicks
from nasm.symmetries import ray
from pipeline.cubes.breakdown import job_on_rays, scales
from pipeline.cubes.certificates import of_certificate, packed
from pipeline.cubes.cube import angles_of_rays, blank, coordinate, text

_N_QUOTIENTS = 32  # places for the partial quotients of a rotation number
_PROVED = {
    "proved_below": "scale up to which a barrier is proved to exist on all the ray",
    "proved_lower": "scale at which a barrier is proved to exist; it says nothing of smaller ones",
    "proved_upper": "scale at which transport is proved to be global",
}


def last_barrier(plane, angles, tol, name="barrier"):
    """Return the Job of the cube `barrier`; ω is a result, exactly by its partial quotients.

    angles : degrees, any; the cube holds those that they fold to, in the plane's symmetries.
    tol : float, the bracket's relative width.
    name : of the cube; another one where a store holds those of several planes.
    """
    seconds = 0.2 + 3.5e-5 / tol if len(plane.origin) <= 2 else 1 + 5e-4 / tol
    warm_up = partial(barriers.critical_scale, sum(plane.ray(30.0)), 0.1)
    return _job(name, plane, angles, seconds, {"tol": tol}, _compute, warm_up)


def proved_barrier(plane, angles, seconds):
    """Return the Job of the cube `proved_barrier`: `last_barrier`, and what is proved of each ray.

    angles : degrees. seconds : float, CPU time for each proof of each ray; see `nasm.proofs`. The
    proved bounds depend on the machine's speed; each of them holds.
    """
    plane.rays_start_at_zero("a proof")
    settings, quick = {"tol": 1e-4, "seconds": seconds}, plane.record | {"seconds": 0.1}
    how = _compute_proved, partial(_compute_proved, {"angle": np.zeros(1)}, quick)
    return _job("proved_barrier", plane, angles, 1 + 3 * seconds, settings, *how, _PROVED)


def _job(name, plane, angles, seconds, settings, compute, warm_up, more=()):
    wedge = sorted(set(plane.fold(angles)[0].tolist()))
    on_ray = {"angle": angles_of_rays(wedge)}
    more = last_circles(on_ray) | {key: blank(on_ray, words) for key, words in dict(more).items()}
    how = seconds, plane.record | settings, compute, warm_up, "The last barrier to transport", more
    return job_on_rays(name, plane.axes, {}, wedge, *how)


def last_circles(on):
    """Return the variables of last circles over the coordinates `on`."""
    place = {"quotient": coordinate("quotient", range(_N_QUOTIENTS), "place of a partial quotient")}
    zero, comment = np.int32(0), "0 behind the last one"
    return place | {
        "omega": blank(on, "rotation number of the last circle, per step"),
        "quotients": blank(place | on, "partial quotients of omega", zero, comment=comment),
        "tail_length": blank(on, "partial quotients at the end that repeat", np.int8(0)),
    }


def named(plane):
    """Return the name of the cube in a store of several planes, like barrier_rotating_1_3_1_60."""
    return re.sub(r"\W+", "_", f"barrier_{plane.name}", flags=re.ASCII)


def boundary(angles, tol=1e-4, plane=None):
    """Compute CB_gt on rays at any angles: the Dataset of `unfolded`, without workers or a store.

    angles : degrees. tol : float, 1e-5 to 0.1, the bracket's relative width. plane : of forcings,
    `nasm.planes.two_kicks()` by default. A ray that is no image of another one takes 0.25 s of CPU
    time at 1e-4, and 0.8 s at 2e-5.
    """
    cube = last_barrier(plane or two_kicks(), angles, tol).cube
    filled = cube.filled(_compute({"angle": cube.template.angle.values}, cube.settings))
    return unfolded(filled.assign_attrs(cube.attributes), angles)


def unfolded(barrier, angles):
    """Return the cube `barrier` on rays whose images it holds: a Dataset with dim (angle).

    Its coordinate `circle` is the exact text of the last circle's ω in [0, P/2], "" where none is
    named; that of P - ω is its mirror image. `tied` is that of a circle that breaks together with
    it, as on the axes of two kicks; "" elsewhere.
    """
    angles, plane = np.asarray(angles, dtype=float), plane_of(barrier.attrs)
    folded, shifts = plane.fold(angles)
    there = barrier.load().sel(angle=folded, method="nearest", tolerance=1e-8)
    circles = exact_circles(there, shifts.tolist())
    ties = map(partial(tie, plane), circles, angles, there.critical_scale.values)
    table = there.drop_vars(["quotients", "tail_length", "quotient"]).assign_coords(
        angle=angles_of_rays(angles),
        circle=text("angle", circles, "exact rotation number of the last circle, per step"),
        tied=text("angle", ties, "that of a circle that breaks with it"),
    )
    for name, direction in zip(plane.axes, ray(angles).T, strict=True):
        values = table.critical_scale.values * direction
        table = table.assign_coords({name: ("angle", values, barrier[name].attrs)})
    omega = np.where(shifts, shifts - table.omega, table.omega)
    table["omega"] = table.omega.copy(data=omega)
    return table


def exact_circles(cube, shifts):
    """List the exact texts of the last circles' ω in a cube, or of `shift` - ω where that is not 0;
    "" where none is named."""
    circles = []
    entries = cube.quotients.values.T.tolist(), cube.tail_length.values.tolist(), shifts
    for quotients, length, shift in zip(*entries, strict=True):
        quotients = tuple(np.trim_zeros(quotients, "b"))
        omega = quotients and RotationNumber(quotients[:-length], quotients[-length:])
        circles.append(str(moebius(omega, -1, shift) if omega and shift else omega or ""))
    return circles


def tie(plane, circle, angle, scale):
    """Return the text of the ω that breaks together with that of `circle`, at scale; else ""."""
    start, profile = plane.ray(angle)
    return str(barriers.tied(parse(circle), start + scale * profile) or "") if circle else ""


def _compute(coords, settings):
    (start, profiles), tol = plane_of(settings).ray(coords["angle"]), settings["tol"]
    found = [barriers.critical_scale(profile, tol, start) for profile in profiles]
    return scales(found, plane_of(settings).axes, coords["angle"]) | circle_arrays(found)


def _compute_proved(coords, settings):
    from nasm import proofs  # python-flint takes a while to import, and is an extra

    plane = plane_of(settings)
    profiles = plane.ray(coords["angle"])[1]
    brackets = [proofs.critical_scale(profile, settings["seconds"]) for profile in profiles]
    found = [bracket.found for bracket in brackets]
    arrays = scales(found, plane.axes, coords["angle"]) | circle_arrays(found)
    for key in _PROVED:
        side = key.removeprefix("proved_")
        arrays[key] = np.array([getattr(bracket, side) for bracket in brackets])
    return arrays | packed(proof for b in brackets for proof in (b.barrier, b.transport, *b.rays))


def uncertified(tile, certificates):
    """Say what a tile of `proved_barrier` calls proved without a certificate of it; else ""."""
    from nasm.proofs.fan import covered

    claimed, rays = set(), {}
    for certificate in certificates:
        kappa = of_certificate(certificate["shortened_from"], "kappa")
        if "scales" in certificate:
            rays.setdefault(kappa, []).append(of_certificate(certificate, "scales"))
        else:
            claimed.add((certificate["shortened_from"].get("omega"), kappa))
    circles = exact_circles(tile.load(), [0] * tile.angle.size)
    for i, profile in enumerate(plane_of(tile.attrs).ray(tile.angle.values)[1]):
        here, at = tile.isel(angle=i), f"at {float(tile.angle[i]):g} degrees"
        if float(here.proved_below) > covered(rays.get(tuple(profile.tolist()), [])):
            return f"proved_below {at} has no certificates"
        for side, omega in (("proved_lower", circles[i]), ("proved_upper", None)):
            scale = float(here[side])
            if scale > 0 and (omega, tuple((scale * profile).tolist())) not in claimed:
                return f"{side} {at} has no certificate"
    return ""


def circle_arrays(found):
    """Return the arrays of `last_circles`; `found` is a list."""
    arrays = {"omega": np.array([s.omega and float(s.omega) for s in found], dtype=float)}
    known = [(s.omega.prefix, s.omega.tail) if s.omega else ((), ()) for s in found]
    rows = [[*prefix, *tail] for prefix, tail in known]
    padded = [row + [0] * (_N_QUOTIENTS - len(row)) for row in rows]
    arrays["quotients"] = np.array(padded, np.int32).T
    arrays["tail_length"] = np.array([len(tail) for _, tail in known], np.int8)
    return arrays
