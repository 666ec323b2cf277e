"""Where along the angle one boundary lies outside another."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Stretch:
    """Angles, in degrees, between which a ratio is above 1, and the angle and size of its peak."""

    start: float
    end: float
    peak_angle: float
    peak: float

    def __str__(self):
        """E.g. 12.0°-14.5° (by 3.1% at 13.0°)."""
        return (
            f"{self.start:.1f}°-{self.end:.1f}° "
            f"(by {100 * (self.peak - 1):.2g}% at {self.peak_angle:.1f}°)"
        )


def stretches(angle, ratio):
    """The stretches on which `ratio` is above 1; their ends are interpolated between the rays.

    angle, ratio : vectors, the angles increasing. Rays without a ratio (NaN) end a stretch.
    """
    import numpy as np

    above = np.concatenate([[False], ratio > 1, [False]])
    (firsts,) = np.nonzero(above[1:] & ~above[:-1])
    (ends,) = np.nonzero(~above[1:] & above[:-1])
    found = []
    for first, end in zip(firsts, ends, strict=True):
        peak = first + int(np.argmax(ratio[first:end]))
        start = _crossing(angle, ratio, first, first - 1)
        stop = _crossing(angle, ratio, end - 1, end)
        found.append(Stretch(start, stop, float(angle[peak]), float(ratio[peak])))
    return found


def where_above(angle, ratio):
    """In words: the stretches, or where the ratio comes nearest to 1."""
    import numpy as np

    found = stretches(angle, ratio)
    if found or not np.isfinite(ratio).any():
        return ", ".join(map(str, found)) or "unknown"
    nearest = int(np.nanargmax(ratio))
    return f"nowhere (nearest, {ratio[nearest]:.3f} of it, at {angle[nearest]:.1f}°)"


def _crossing(angle, ratio, inside, outside):
    """Between the last ray above 1 and the first one not above; that last ray if there is none."""
    if not 0 <= outside < ratio.size or not ratio[outside] <= 1:
        return float(angle[inside])
    share = (ratio[inside] - 1) / (ratio[inside] - ratio[outside])
    return float(angle[inside] + share * (angle[outside] - angle[inside]))
