"""Where along the angle one boundary lies outside another, in words."""

import numpy as np


def stretches(angle, ratio):
    """List (start, end, angle of the peak, peak) of the stretches on which `ratio` is above 1.

    angle, ratio : vectors, the angles increasing. The ends are interpolated between the rays; rays
    without a ratio (NaN) end a stretch.
    """
    found = []
    for first, end in np.flatnonzero(np.diff(np.pad(ratio > 1, 1))).reshape(-1, 2):
        peak = first + int(np.argmax(ratio[first:end]))
        start = _crossing(angle, ratio, first, first - 1)
        stop = _crossing(angle, ratio, end - 1, end)
        found.append((start, stop, float(angle[peak]), float(ratio[peak])))
    return found


def where_above(angle, ratio):
    """Say where the ratio is above 1, "12.0°-14.5° (by 3.1% at 13.0°)", or else nearest to 1."""
    found = stretches(angle, ratio)
    if not np.isfinite(ratio).any():
        return "unknown"
    if found:
        return ", ".join(
            f"{start:.1f}°-{end:.1f}° (by {100 * (peak - 1):.2g}% at {at:.1f}°)"
            for start, end, at, peak in found
        )
    nearest = int(np.nanargmax(ratio))
    return f"nowhere (nearest, {ratio[nearest]:.3f} of it, at {angle[nearest]:.1f}°)"


def _crossing(angle, ratio, inside, outside):
    """Interpolate the angle at which the ratio is 1; without a ratio outside, the ray inside."""
    if not 0 <= outside < ratio.size or not ratio[outside] <= 1:
        return float(angle[inside])
    share = (ratio[inside] - 1) / (ratio[inside] - ratio[outside])
    return float(angle[inside] + share * (angle[outside] - angle[inside]))
