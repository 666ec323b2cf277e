"""Sentences about a boundary: its position, its last circles, and their uncertainty."""

import numpy as np
import xarray as xr

from nasm.planes import plane_of, two_kicks
from nasm.symmetries import ray
from pipeline.sweep.progress import plural
from workflows.figures.style import arcs
from workflows.shared.rays import circle_text


def describe_boundary(barrier: xr.Dataset) -> str:
    """Describe CB_gt: its position, its last circles and its brackets.

    The position is described only for two kicks, on the axes and on the diagonals.

    Parameters
    ----------
    barrier : xarray.Dataset
        Table returned by `barrier.unfolded`, on rays from 0 to 180 or 360 degrees.

    Returns
    -------
    str
        Sentences.
    """
    two = plane_of(barrier.attrs) == two_kicks()
    places, last, where = [], 360, f"up to {float(barrier.angle[-1]):g}°"
    if two:
        last, where = 45, "from 0° to 45° (the rest are mirror images)"
    for name, angle in (("axes", 0.0), ("diagonals |κ1| = |κ2|", 45.0)):
        if two and (barrier.angle == angle).any():
            one = barrier.sel(angle=angle)
            kappa, error = (float(one[key]) * ray(angle)[0] for key in ("critical_scale", "error"))
            circle = circle_text(one.circle.item(), one.tied.item())
            places.append(f"{kappa:.10g} ± {error:.0e} on the {name} (last circle: {circle})")
    sector = barrier.sel(angle=slice(None, last))
    shares = arcs(sector.angle.values, sector.circle.values)
    large = shares[shares >= 0.01][:6]
    share = ", ".join(f"{circle or 'undecided'} {share:.0%}" for circle, share in large.items())
    others = len(shares) - len(large)
    width = ((barrier.upper - barrier.lower) / barrier.critical_scale).dropna("angle")
    bracket = "No ray has a bracket"
    if width.size:
        bracket = (
            f"On {plural(width.size, 'ray')} the boundary is bracketed by a certified circle "
            "(below) and converse KAM (above); the bracket's median relative width is "
            f"{float(width.median()):.1e}, the largest {float(width.max()):.1e}"
        )
    undecided = plural(int(barrier.critical_scale.isnull().sum()), "ray")
    onset = f"Global transport begins at κ = {'; '.join(places)}. " if two else ""
    return (
        f"{onset}The last circles to break, by their fraction of the angle {where}: {share}"
        f"{', and ' + plural(others, 'other') if others > 0 else ''}. "
        f"{bracket}. Undecided: {undecided}."
    )


def describe_direct_iteration(direct: xr.Dataset, barrier: xr.Dataset, n_orbits: int) -> str:
    """Describe how far outside CB_gt direct iteration puts the boundary, for each number of steps.

    Parameters
    ----------
    direct : xarray.Dataset
        `critical_scale`, dims (n, angle), and `resolution`, the width of a cell.
    barrier : xarray.Dataset
        `critical_scale` of the last barrier on the same rays.
    n_orbits : int
        Size of the ensemble.

    Returns
    -------
    str
        Sentences.
    """
    scale = direct.critical_scale
    excess = 100 * (scale / barrier.critical_scale - 1)
    parts = []
    for n in scale.n.values.tolist():
        known = excess.sel(n=n).dropna("angle").values
        if known.size:
            parts.append(
                f"within {n} steps by {np.median(known):.1f}% ({known.min():.1f} to "
                f"{known.max():.1f}%) on {plural(known.size, 'ray')}"
            )
    if not parts:
        return (
            f"Direct iteration of {n_orbits} orbits detects no transport in this plane, which does "
            "not prove a barrier."
        )
    cell = 100 * float((direct.resolution / scale).median())
    # Second differences cancel slow changes; their median ignores the cusps.
    differences = np.abs(np.diff(excess.transpose("n", "angle").values, 2))
    differences = differences[np.isfinite(differences)]
    scatter = np.median(differences) / (0.6745 * 6**0.5) if differences.size else 0
    between = f", scatter between rays {scatter:.2g}%" if scatter > 0 else ""
    return (
        f"Direct iteration of {n_orbits} orbits puts the boundary too far out: "
        f"{'; '.join(parts)} (medians; cells {cell:.2g}% wide{between}). Absence of escape does "
        "not prove a barrier."
    )


def describe_escape_field(field: xr.Dataset) -> str:
    """Describe where in the plane each ensemble of the cube `escape` escapes, and when."""
    times, n_max = field.escape_time.load(), field.attrs["n_max"]
    steps = sorted({max(1, n_max // 10), n_max})
    parts = []
    for size in times.ensemble.values.tolist():
        one = times.sel(ensemble=size)
        shares = [f"{100 * float((one <= n).mean()):.1f}% within {n}" for n in steps]
        parts.append(f"with {size} orbits {' and '.join(shares)} steps")
    plane, first = plane_of(field.attrs), float(times.min())
    names = ("κ1", "κ2") if plane == two_kicks() else plane.axes
    ends = (field[f"{dim}_bounds"].values for dim in times.dims[:0:-1])
    ranges = ", ".join(
        f"{n} = {e.min():.3g} to {e.max():.3g}" for n, e in zip(names, ends, strict=True)
    )
    earliest = f" The earliest escape takes {plural(first, 'step', 'g')}." if first < np.inf else ""
    return (
        f"Fraction of the plane {ranges} in which at least one orbit escapes, so that transport is "
        f"global: {'; '.join(parts)}.{earliest} Where no orbit escapes nothing is proved: with "
        "more steps the boundary moves inwards like N^(-1/3)."
    )
