"""What is computed on wish: an ensemble that spreads from a box, the resonance of p/q, residues."""

from contextlib import suppress
from itertools import product
from time import sleep

import numpy as np

from nasm import action, manifolds, orbits
from nasm.numbers import distinct_convergents
from pipeline.sweep.progress import plural
from workflows.shared.phase_space import in_box

MANIFOLDS = {"unstable": manifolds.unstable, "stable": manifolds.stable}
_LENGTH = 8.0  # turns of all branches of a kind together
_SIDE, _DOUBLINGS = 48, 13  # of an ensemble: starts along a side, of the number of periods
_LOOK = 0.15  # seconds, so that one sees it spread
_MOST_Q = 60  # of the convergents whose residues are followed
_N_RESIDUES, PLACES = 3, 60  # places along a segment, besides its start


def spreading(kappa, box):
    """Yield how an ensemble spreads that starts evenly in the middle of a box, a tenth as wide and
    high, each time n has doubled: columns {"x", "y"} of points, on the lift; {"n", "variance"} so
    far; and D in words."""
    left, bottom, width, height = box
    places = 0.45 + 0.1 * (np.arange(_SIDE) + 0.5) / _SIDE
    x, y = map(np.ravel, np.meshgrid(left + width * places, bottom + height * places))
    first, squares, found = y, 0.0, {"n": [], "variance": []}
    for n in 2 ** np.arange(_DOUBLINGS + 1):
        (_, x), (_, y) = orbits.orbit(np.tile(kappa, n - n // 2), x, y, 1)
        before, squares = squares, (y - first) ** 2
        found = {"n": [*found["n"], int(n)], "variance": [*found["variance"], squares.mean()]}
        rates = (squares - before) / n  # from n/2 to n
        words = f"The ensemble after {plural(n, 'period')}: variance {squares.mean():.4g}, "
        words += f"D = {rates.mean():.3g} ± {rates.std() / rates.size**0.5:.1g} a period."
        yield {"x": x, "y": y}, found, words
        sleep(_LOOK)


def resonance(kappa, fraction, box):
    """Return {"unstable", "stable", "lobes"} of the minimizing p/q orbit, columns {"x", "y"} of the
    curves in the box and of lists of edges; and the flux of its turnstiles in words."""
    p, q = fraction.numerator, fraction.denominator
    lines, lobes = {name: [np.array([[], []])] for name in MANIFOLDS}, []
    areas, reasons = [], []
    try:
        xs, ys = action.ordered_orbits(kappa, p, q)[0].points()
        for name, toward, place in product(MANIFOLDS, (1, -1), zip(xs, ys, strict=True)):
            curve = MANIFOLDS[name](kappa, p, q, *place, _LENGTH / 2 / q, toward=toward)
            lines[name] += np.array([*in_box(box, *curve)]), np.full((2, 1), np.nan)
    except (action.LostError, ValueError) as error:
        reasons.append(f"No manifolds: {error}.")
    for edge in ("upper", "lower"):
        try:
            found = manifolds.turnstile(kappa, p, q, edge == "upper")
        except action.LostError as lost:
            reasons.append(f"No turnstile at its {edge} edge: {lost}.")
            continue
        lobes += found.lobes
        areas.append(f"{found.area:.4g} through its {edge} edge")
    words = f"Turnstiles of {fraction}: {' and '.join(areas)}, a step." if areas else ""
    words = " ".join(filter(None, [words, *dict.fromkeys(reasons)]))
    drawn = {name: dict(zip("xy", np.hstack(parts), strict=True)) for name, parts in lines.items()}
    return drawn | {"lobes": {"x": [x for x, _ in lobes], "y": [y for _, y in lobes]}}, words


def residues(start, profile, omega):
    """Return {"at", "residue": lists of lists; "orbit": names} of convergents of ω along a segment.

    start, profile : of the forcings start + s·profile, s from 0 to 1. Minimax orbits; NaN
    where one is not found.
    """
    orbits = action.ConvergentOrbits(start, profile, distinct_convergents(omega, _MOST_Q))
    at, names = np.linspace(0, 1, PLACES + 1), [f"{one.p}/{one.q}" for one in orbits.chains]
    first = max(0, len(names) - _N_RESIDUES)
    found = np.full((len(names) - first, at.size), np.nan)
    for n, i in np.ndindex(found.shape):
        with suppress(action.LostError):
            found[n, i] = orbits.at(first + n, at[i], -1).residue
    return {"at": [at.tolist()] * len(found), "residue": found.tolist(), "orbit": names[first:]}
