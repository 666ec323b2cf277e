"""Orbits in a box of phase space with their rotation numbers, as Datasets.

In the whole cell the starts are those of `orbits.portrait`. In a smaller box the starts are spread
over the box, and only points inside it are kept; the orbits are then iterated for longer, so that a
small box shows as many points as the whole cell.
"""

from collections.abc import Iterable, Iterator
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from nasm import orbits
from nasm.action import LostError, ordered_orbits
from nasm.maps import forcing
from nasm.types import FloatArray
from workflows.shared.tables import dataset, described

if TYPE_CHECKING:
    import xarray as xr

Box = tuple[float, float, float, float]
"""Left, bottom, width and height of a part of phase space."""

CELL: Box = (0.0, -0.25, 1.0, 1.0)
"""The unit cell, placed so that it does not cut the circles with 0 ≤ ω/P ≤ 1/2."""

_N_ORBITS, _STEPS = 80, 600
_MIN_AVERAGED, _MAX_AVERAGED = 2000, 10**5  # steps over which ω is averaged
_MAX_KICKS = 10**8  # iterating so many kicks takes a second or two
_MAX_POINTS = 2 * 10**5  # enough for a screen


def portrait(kappa: ArrayLike) -> "xr.Dataset":
    """Return the portrait of the whole cell, as in the figure of `ask`; see `portraits`."""
    return next(portraits(kappa, first=_STEPS))


def portraits(
    kappa: ArrayLike,
    box: Box = CELL,
    added: ArrayLike = (),
    every: int | None = None,
    first: int = 1000,
) -> Iterator["xr.Dataset"]:
    """Yield the portrait of a box with more and more points, doubling the steps each time.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        One period of kicks.
    box : (left, bottom, width, height)
        As for `orbits.passages`.
    added : array_like, shape (n, 2)
        Additional starts (x, y).
    every : int, optional
        Number of kicks from one point to the next; by default P, which is one step.
    first : int
        Number of points, inside or outside the box, computed for each orbit before the first yield.

    Yields
    ------
    xarray.Dataset
        `x`, `y` and `which`, the number of the orbit, have dim (point). `start_x`, `start_y`,
        `omega` (NaN if chaotic) and `near` have dim (orbit); `near` is ω reduced to [0, P/2], since
        ±ω and ω + P·n are equivalent. ω is averaged over the number of steps drawn, but at least
        2000 and at most 10⁵.
    """
    kappa = forcing(kappa)
    starts = np.concatenate([_starts(box), np.reshape(added, (-1, 2))]).T
    passages, state, done, over = [], starts, 0, False
    while not over:
        *more, state = orbits.passages(kappa, state[0], state[1], done or first, box, every)
        passages.append(more)
        done += done or first
        n_averaged = int(np.clip(done, _MIN_AVERAGED, _MAX_AVERAGED))
        omega, _ = orbits.rotation_number(kappa, starts[0], starts[1], n_averaged)
        which, x, y = map(np.concatenate, zip(*passages, strict=True))
        yield _dataset(kappa, box, starts, omega, which, x, y)
        kicks = done * starts[0].size * (every or kappa.size)
        over = 2 * kicks > _MAX_KICKS or which.size > _MAX_POINTS


def _starts(box):
    """Return starts, shape (n, 2): on x = 0 and 1/2 in the whole cell, else all over the box."""
    if tuple(box[2:]) == CELL[2:]:
        x, y = orbits.portrait([0.0], _N_ORBITS, 0)
        return np.stack([x[0], y[0]], axis=1)
    left, bottom, width, height = box
    # Multiples of 1/ρ and 1/ρ², mod 1, where ρ is the plastic number, fill a square as evenly as
    # multiples of γ fill a line.
    steps = np.array([0.7548776662466927, 0.5698402909980532])
    places = np.arange(1, _N_ORBITS + 1)[:, None] * steps
    return np.array([left, bottom]) + places % 1 * np.array([width, height])


def _dataset(kappa, box, starts, omega, which, x, y):
    half = kappa.size / 2
    near = abs((omega + half) % (2 * half) - half)
    label = "rotation number per step, by weighted Birkhoff average; NaN: chaotic"
    variables = {
        "x": ("point", x, described("x", "turn")),
        "y": ("point", y, "y, mod 1"),
        "which": ("point", which.astype("int32"), "number of the point's orbit"),
        "start_x": ("orbit", starts[0], described("x of the orbit's start", "turn")),
        "start_y": ("orbit", starts[1], "y of the orbit's start"),
        "omega": ("orbit", omega, label),
        "near": ("orbit", near, "omega reduced to [0, P/2], up to sign and multiples of P"),
    }
    attrs = {"kappa": kappa.tolist(), "box": list(box)}
    attrs["references"] = "arXiv:1606.04824, Eqs. (1) and (23)"
    return dataset("Orbits in a box of phase space", {}, variables, attrs)


def in_box(box: Box, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Clip a curve to a box.

    Parameters
    ----------
    box : (left, bottom, width, height)
    x, y : arrays, shape (n,)
        Points on the lift, in order along the curve.

    Returns
    -------
    x, y : arrays
        The points in the box, with NaN where the curve leaves it.
    """
    left, bottom, width, height = box
    middle = left + width / 2, bottom + height / 2
    u, v = ((w - centre + 0.5) % 1 - 0.5 for w, centre in zip((x, y), middle, strict=True))
    jumps = np.flatnonzero((abs(np.diff(u)) > 0.5) | (abs(np.diff(v)) > 0.5)) + 1
    u, v = np.insert(u, jumps, np.nan), np.insert(v, jumps, np.nan)
    inside = (abs(u) <= width / 2) & (abs(v) <= height / 2)
    # Keep one point beyond the edge at each crossing, so that the line reaches the edge.
    kept = inside | np.r_[False, inside[:-1]] | np.r_[inside[1:], False]
    kept |= np.isnan(u) & np.r_[False, kept[:-1]]  # also keep a gap that follows a kept point
    u, v = np.where(kept, u, np.nan), np.where(kept, v, np.nan)
    kept |= np.r_[False, kept[:-1]]
    return middle[0] + u[kept], middle[1] + v[kept]


def periodic_orbits(
    kappa: ArrayLike, fractions: Iterable[Fraction]
) -> tuple[list[tuple[Fraction, str, FloatArray, FloatArray, float]], list[str]]:
    """Find the ordered orbits of the fractions p/q.

    Returns
    -------
    located : list of (p/q, family, x, y, residue)
        The family is "minimizing" or "minimax".
    missing : list of str
        For each fraction whose orbits are missing, a sentence that explains why.
    """
    located, missing = [], []
    for fraction in fractions:
        try:
            both = ordered_orbits(kappa, fraction.numerator, fraction.denominator)
        except LostError as lost:
            missing.append(f"Not drawn: {lost}.")
            continue
        for family, orbit in zip(("minimizing", "minimax"), both, strict=True):
            located.append((fraction, family, *orbit.points(), orbit.refined_residue()))
    return located, missing
