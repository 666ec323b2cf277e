"""Sentences about a boundary: where it is, which circles share it, how sure that is."""

import numpy as np

from nasm.planes import plane_of, two_kicks
from nasm.symmetries import ray
from pipeline.sweep.progress import plural
from workflows.figures.style import arcs
from workflows.shared.rays import named


def boundary_found(barrier):
    """Say which circles share CB_gt, how sure it is, and where it is on two kicks' axes, diagonals.

    barrier : table of `barrier.unfolded`, of rays from 0 to 180 or 360 degrees.
    """
    two = plane_of(barrier.attrs) == two_kicks()
    places, last, where = [], 360, f"up to {float(barrier.angle[-1]):g}°"
    if two:
        last, where = 45, "from 0° to 45° (the rest are mirror images)"
    for name, angle in (("axes", 0.0), ("diagonals |κ1| = |κ2|", 45.0)):
        if two and (barrier.angle == angle).any():
            here = barrier.sel(angle=angle)
            kappa, error = (float(here[key]) * ray(angle)[0] for key in ("critical_scale", "error"))
            circle = named(here.circle.item(), here.tied.item())
            places.append(f"{kappa:.10g} ± {error:.0e} on the {name} (last circle: {circle})")
    seen = barrier.sel(angle=slice(None, last))
    shares = arcs(seen.angle.values, seen.circle.values)
    large = shares[shares >= 0.01][:6]
    share = ", ".join(f"{circle or 'undecided'} {share:.0%}" for circle, share in large.items())
    others = len(shares) - len(large)
    width = ((barrier.upper - barrier.lower) / barrier.critical_scale).dropna("angle")
    apart = "no bracket was found"
    if width.size:
        apart = (
            "the boundary lies between a certified circle and converse KAM, in the median "
            f"{float(width.median()):.1e} of the scale apart, at most {float(width.max()):.1e}"
        )
    open_ = plural(int(barrier.critical_scale.isnull().sum()), "ray")
    begins = f"Global transport begins at κ = {'; '.join(places)}. " if two else ""
    return (
        f"{begins}The last circle to "
        f"break is, by share of the angle {where}: {share}"
        f"{', and ' + plural(others, 'other') if others > 0 else ''}. "
        f"On {plural(barrier.angle.size, 'ray')} {apart}; undecided: {open_}."
    )


def direct_found(direct, barrier, n_orbits):
    """Say how far outside CB_gt direct iteration lies, for each N.

    direct : Dataset of its `critical_scale`, dims (n, angle), and the cell's width, `resolution`.
    """
    scale = direct.critical_scale
    excess = 100 * (scale / barrier.critical_scale - 1)
    parts = []
    for n in scale.n.values.tolist():
        here = excess.sel(n=n).dropna("angle").values
        if here.size:
            parts.append(
                f"within {n} steps {np.median(here):.1f}% ({here.min():.1f} to {here.max():.1f}%) "
                f"on {plural(here.size, 'ray')}"
            )
    where = "nowhere in this plane"
    if parts:
        cell = 100 * float((direct.resolution / scale).median())
        where = f"{'; '.join(parts)} (median; its cells are {cell:.2g}% wide"
        # By second differences, in which what changes slowly cancels; their median, which cusps do
        # not move.
        apart = np.abs(np.diff(excess.transpose("n", "angle").values, 2))
        apart = apart[np.isfinite(apart)]
        scatter = np.median(apart) / (0.6745 * 6**0.5) if apart.size else 0
        where += f", and from ray to ray it scatters by {scatter:.2g}%)" if scatter > 0 else ")"
    return (
        f"Direct iteration of {n_orbits} orbits sees transport only further out: {where}. "
        "No escape shows no barrier."
    )


def field_found(field):
    """Say in how much of the plane of the cube `escape` each ensemble escapes within how long."""
    times, n_max = field.escape_time.load(), field.attrs["n_max"]
    steps = sorted({max(1, n_max // 10), n_max})
    parts = []
    for size in times.ensemble.values.tolist():
        here = times.sel(ensemble=size)
        shares = [f"{100 * float((here <= n).mean()):.1f}% within {n}" for n in steps]
        parts.append(f"of {size} orbits in {' and '.join(shares)}")
    plane, first = plane_of(field.attrs), float(times.min())
    names = ("κ1", "κ2") if plane == two_kicks() else plane.axes
    ends = (field[f"{dim}_bounds"].values for dim in times.dims[:0:-1])
    ranges = ", ".join(
        f"{n} = {e.min():.3g} to {e.max():.3g}" for n, e in zip(names, ends, strict=True)
    )
    return (
        f"Some orbit escapes, which is global transport, in these parts of the plane {ranges}: "
        f"{'; '.join(parts)} steps{f', first after {first:g}' if first < np.inf else ''}. Where "
        "none escapes nothing is shown: with more steps the boundary moves inwards like N^(-1/3)."
    )
