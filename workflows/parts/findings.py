"""What a boundary tells, in words: where it is, which circles share it, how sure that is."""

import numpy as np

from nasm.symmetries import ray
from workflows.parts.rays import with_tie

_NAMED = 6  # circles that are named with their share


def boundary_found(barrier):
    """Say where CB_gt is on the axes and the diagonals, which circles share it, and how sure it is.

    barrier : table of `rays.unfolded`, of rays from 0 to 180 degrees.
    """
    places = []
    for name, angle in (("axes", 0.0), ("diagonals |κ1| = |κ2|", 45.0)):
        if (barrier.angle == angle).any():
            here = barrier.sel(angle=angle)
            kappa, error = (float(here[key]) * ray(angle)[0] for key in ("critical_scale", "error"))
            circle = with_tie(here.circle.item(), angle)
            places.append(f"{kappa:.10g} ± {error:.0e} on the {name} (last circle: {circle})")
    shares = _shares(barrier)
    large = [entry for entry in shares if entry[1] >= 0.01][:_NAMED]
    named = ", ".join(f"{circle} {100 * share:.0f}%" for circle, share in large)
    others = len(shares) - len(large)
    width = (barrier.upper - barrier.lower) / barrier.critical_scale
    return (
        f"Global transport begins at κ = {'; '.join(places)}. The last circle to "
        f"break is, by share of the angle from 0° to 45° (all else are mirror images): {named}"
        f"{f', and {others} others' if others > 0 else ''}. On {barrier.angle.size} rays the "
        "boundary lies between a certified circle and converse KAM, in the median "
        f"{float(width.median()):.1e} of the scale apart, at most {float(width.max()):.1e}; "
        f"{int((barrier.status != 1).sum())} rays are undecided."
    )


def _shares(barrier):
    """List (circle, its part of the wedge from 0° to 45°), the largest first."""
    wedge = barrier.isel(angle=np.flatnonzero((barrier.angle <= 45).values))
    angle = wedge.angle.values
    borders = np.r_[angle[0], (angle[1:] + angle[:-1]) / 2, angle[-1]]
    share = {}
    for circle, width in zip(wedge.circle.values.tolist(), np.diff(borders), strict=True):
        key = circle or "undecided"
        share[key] = share.get(key, 0.0) + width / (borders[-1] - borders[0])
    return sorted(share.items(), key=lambda item: -item[1])


def direct_found(scale, resolution, barrier, n_orbits):
    """Say how far outside CB_gt direct iteration lies, for each N.

    scale, resolution : DataArrays with dims (n, angle): its boundary, and the cell's width there.
    """
    excess = 100 * (scale / barrier.critical_scale - 1)
    cell = 100 * float((resolution / scale).median())
    parts = []
    for n in scale.n.values.tolist():
        here = excess.sel(n=n).dropna("angle").values
        if here.size:
            parts.append(
                f"within {n} steps {np.median(here):.1f}% ({here.min():.1f} to {here.max():.1f}%) "
                f"on {here.size} rays"
            )
    return (
        f"Direct iteration of {n_orbits} orbits sees transport only further out: "
        f"{'; '.join(parts) or 'nowhere in this plane'} (median; its cells are {cell:.1g}% wide). "
        "No escape shows no barrier."
    )


def field_found(field):
    """Say in how much of the plane each ensemble escapes within how many steps.

    field : the cube `escape`.
    """
    times, n_max = field.escape_time.load(), field.attrs["n_max"]
    steps = sorted({max(1, n_max // 10), n_max})
    parts = []
    for size in times.ensemble.values.tolist():
        here = times.sel(ensemble=size)
        shares = [f"{100 * float((here <= n).mean()):.1f}% within {n}" for n in steps]
        parts.append(f"of {size} orbits in {' and '.join(shares)}")
    first = float(times.min())
    return (
        "Some orbit escapes, which is global transport, in these parts of the plane κ1 = "
        f"{_ends(field.kappa1)}, κ2 = {_ends(field.kappa2)}: {'; '.join(parts)} steps. The "
        f"earliest escape takes {first:g} steps. Where none escapes nothing is shown: with more "
        "steps the boundary moves inwards like N^(-1/3)."
    )


def _ends(axis):
    half = float(axis[1] - axis[0]) / 2
    return f"{float(axis[0]) - half:.3g} to {float(axis[-1]) + half:.3g}"
