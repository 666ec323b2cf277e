"""What there is to see in a piece of phase space: orbits with their rotation numbers, as Datasets.

The starts are those of `orbits.portrait` in the whole cell. In a box they are spread over the box,
and only points in it are kept, so that as many are seen however small it is.
"""

import numpy as np

from nasm import orbits
from nasm.action import LostError, ordered_orbits
from nasm.maps import forcing
from workflows.shared.tables import dataset, described

CELL = (0.0, -0.25, 1.0, 1.0)
"""Left, bottom, width, height: it does not cut the circles of 0 ≤ ω/P ≤ 1/2."""

_ORBITS, _STEPS = 80, 600
_AVERAGED = 2000, 10**5  # steps, the least and the most
_MOST_KICKS, _ENOUGH = 10**8, 2 * 10**5  # a second or two; points for a screen


def portrait(kappa):
    """Return the portrait of the whole cell, as the figure of `ask` has it; see `portraits`."""
    return next(portraits(kappa, first=_STEPS))


def portraits(kappa, box=CELL, added=(), every=None, first=1000):
    """Yield the portrait of a box with more and more points, each time with twice the steps.

    kappa : one period of kicks. box : as for `orbits.passages`. added : (x, y) of more starts.
    every : kicks from one point to the next, default one step. first : points of each orbit, in the
    box or not, when it is yielded for the first time.

    A Dataset of x and y (point), which, the number of its orbit (point); start_x, start_y, omega,
    NaN if chaotic, and near (orbit): ω in [0, P/2], as ±ω and all ω + P·n are alike. ω is averaged
    over as many steps as are drawn, 2000 to 10⁵.
    """
    kappa = forcing(kappa)
    starts = np.concatenate([_starts(box), np.reshape(added, (-1, 2))]).T
    found, state, done, over = [], starts, 0, False
    while not over:
        *more, state = orbits.passages(kappa, *state, done or first, box, every)
        found.append(more)
        done += done or first
        omega, _ = orbits.rotation_number(kappa, *starts, int(np.clip(done, *_AVERAGED)))
        which, x, y = map(np.concatenate, zip(*found, strict=True))
        yield _dataset(kappa, box, starts, omega, which, x, y)
        kicks = done * starts[0].size * (every or kappa.size)
        over = 2 * kicks > _MOST_KICKS or which.size > _ENOUGH


def _starts(box):
    """Return starts, shape (n, 2): on x = 0 and 1/2 in the whole cell, else all over the box."""
    if tuple(box[2:]) == CELL[2:]:
        x, y = orbits.portrait([0.0], _ORBITS, 0)
        return np.stack([x[0], y[0]], axis=1)
    left, bottom, width, height = box
    # Multiples of powers of the plastic number, mod 1, fill a square as evenly as γ's do a line.
    places = np.arange(1, _ORBITS + 1)[:, None] * np.array([0.7548776662466927, 0.5698402909980532])
    return np.array([left, bottom]) + places % 1 * np.array([width, height])


def _dataset(kappa, box, starts, omega, which, x, y):
    half = kappa.size / 2
    near = abs((omega + half) % (2 * half) - half)
    words = "rotation number per step, by weighted Birkhoff average; NaN: chaotic"
    variables = {
        "x": ("point", x, described("x", "turn")),
        "y": ("point", y, "y, mod 1"),
        "which": ("point", which.astype("int32"), "orbit of the point"),
        "start_x": ("orbit", starts[0], described("x of the orbit's start", "turn")),
        "start_y": ("orbit", starts[1], "y of the orbit's start"),
        "omega": ("orbit", omega, words),
        "near": ("orbit", near, "the same in [0, P/2], up to its sign and to P"),
    }
    attrs = {"kappa": kappa.tolist(), "box": list(box)}
    attrs["source"] = "arXiv:1606.04824, Eqs. (1) and (23)"
    return dataset("Orbits in a box of phase space", {}, variables, attrs)


def in_box(box, x, y):
    """Return a curve as a line in the box: x and y of its points, with NaN where it leaves.

    x, y : arrays, on the lift, in order along the curve.
    """
    left, bottom, width, height = box
    middle = left + width / 2, bottom + height / 2
    u, v = ((w - centre + 0.5) % 1 - 0.5 for w, centre in zip((x, y), middle, strict=True))
    jumps = np.flatnonzero((abs(np.diff(u)) > 0.5) | (abs(np.diff(v)) > 0.5)) + 1
    u, v = np.insert(u, jumps, np.nan), np.insert(v, jumps, np.nan)
    inside = (abs(u) <= width / 2) & (abs(v) <= height / 2)
    # One point beyond the edge on either side, so that the line reaches the edge.
    kept = inside | np.r_[False, inside[:-1]] | np.r_[inside[1:], False]
    kept |= np.isnan(u) & np.r_[False, kept[:-1]]  # and one gap
    u, v = np.where(kept, u, np.nan), np.where(kept, v, np.nan)
    kept |= np.r_[False, kept[:-1]]
    return middle[0] + u[kept], middle[1] + v[kept]


def periodic_orbits(kappa, fractions):
    """Return the ordered orbits of the fractions p/q, a list of (p/q, family, x, y, residue), and a
    list of sentences, one for each fraction whose orbits are missing, and why.

    family : "minimizing" or "minimax".
    """
    found, missing = [], []
    for fraction in fractions:
        try:
            both = ordered_orbits(kappa, fraction.numerator, fraction.denominator)
        except LostError as lost:
            missing.append(f"Not drawn: {lost}.")
            continue
        for family, orbit in zip(("minimizing", "minimax"), both, strict=True):
            found.append((fraction, family, *orbit.points(), orbit.refined_residue()))
    return found, missing
