"""Computations on demand: an ensemble that spreads from a box, the resonance of p/q, residues."""

from collections.abc import Iterator
from contextlib import suppress
from fractions import Fraction
from itertools import product
from time import sleep
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from nasm import action, manifolds, orbits
from nasm.numbers import RotationNumber, distinct_convergents
from nasm.types import FloatArray
from pipeline.sweep.progress import plural
from workflows.shared.phase_space import in_box

MANIFOLDS = {"unstable": manifolds.unstable, "stable": manifolds.stable}
_TOTAL_LENGTH = 8.0  # total length of all branches of one kind, in turns
_SIDE_STARTS, _DOUBLINGS = 48, 13  # starts along a side; doublings of the number of periods
_FRAME_SECONDS = 0.15  # pause between frames, so that the spreading is visible
_MAX_Q = 60  # largest q of the convergents whose residues are computed
_N_RESIDUES, PLACES = 3, 60  # number of convergents; places along a segment, besides its start


def spreading(
    kappa: FloatArray, box: tuple[float, float, float, float]
) -> Iterator[tuple[dict[str, Any], dict[str, list], str]]:
    """Iterate an ensemble from the middle of a box; yield it after 1, 2, 4, … periods.

    Parameters
    ----------
    kappa : array, shape (P,)
        One period of kicks.
    box : (left, bottom, width, height)
        The starts are spread evenly over the middle tenth of its width and of its height.

    Yields
    ------
    points : dict
        Columns "x" and "y", on the lift.
    variances : dict
        Columns "n" and "variance", for each n so far.
    text : str
        The diffusion coefficient D, in a sentence.
    """
    left, bottom, width, height = box
    places = 0.45 + 0.1 * (np.arange(_SIDE_STARTS) + 0.5) / _SIDE_STARTS
    x, y = map(np.ravel, np.meshgrid(left + width * places, bottom + height * places))
    history: dict[str, list] = {"n": [], "variance": []}
    first, squares = y, 0.0
    for n in 2 ** np.arange(_DOUBLINGS + 1):
        (_, x), (_, y) = orbits.orbit(np.tile(kappa, n - n // 2), x, y, 1)
        before, squares = squares, (y - first) ** 2
        variances = [*history["variance"], squares.mean()]
        history = {"n": [*history["n"], int(n)], "variance": variances}
        rates = (squares - before) / n  # between periods n/2 and n
        text = f"The ensemble after {plural(int(n), 'period')}: variance {squares.mean():.4g}, "
        text += f"D = {rates.mean():.3g} ± {rates.std() / rates.size**0.5:.1g} per period."
        yield {"x": x, "y": y}, history, text
        sleep(_FRAME_SECONDS)


def resonance(
    kappa: ArrayLike, fraction: Fraction, box: tuple[float, float, float, float]
) -> tuple[dict[str, dict[str, Any]], str]:
    """Compute the manifolds and turnstile lobes of the minimizing p/q orbit.

    Returns
    -------
    curves : dict
        "unstable" and "stable": columns "x" and "y" of the manifolds in the box; "lobes": lists
        of the edges of the lobes.
    text : str
        The flux of the turnstiles, in a sentence, and the reasons for anything missing.
    """
    p, q = fraction.numerator, fraction.denominator
    lines = {name: [np.array([[], []])] for name in MANIFOLDS}
    lobes: list[Any] = []
    areas: list[str] = []
    reasons: list[str] = []
    try:
        xs, ys = action.ordered_orbits(kappa, p, q)[0].points()
        for name, toward, place in product(MANIFOLDS, (1, -1), zip(xs, ys, strict=True)):
            length = _TOTAL_LENGTH / 2 / q
            curve = MANIFOLDS[name](kappa, p, q, place[0], place[1], length, toward=toward)
            lines[name] += np.array([*in_box(box, *curve)]), np.full((2, 1), np.nan)
    except (action.LostError, ValueError) as error:
        reasons.append(f"No manifolds: {error}.")
    for edge in ("upper", "lower"):
        try:
            turnstile = manifolds.turnstile(kappa, p, q, edge == "upper")
        except action.LostError as lost:
            reasons.append(f"No turnstile at the {edge} edge: {lost}.")
            continue
        lobes += turnstile.lobes
        areas.append(f"{turnstile.area:.4g} through the {edge} edge")
    flux = f"Turnstiles of {fraction}: {' and '.join(areas)} per step." if areas else ""
    text = " ".join(filter(None, [flux, *dict.fromkeys(reasons)]))
    drawn = {name: dict(zip("xy", np.hstack(parts), strict=True)) for name, parts in lines.items()}
    return drawn | {"lobes": {"x": [x for x, _ in lobes], "y": [y for _, y in lobes]}}, text


def residues(start: FloatArray, profile: FloatArray, omega: RotationNumber) -> dict[str, list]:
    """Compute residues of the minimax orbits of convergents of ω along a segment of forcings.

    Parameters
    ----------
    start, profile : arrays, shape (P,)
        The segment of forcings start + s·profile, s from 0 to 1.
    omega : RotationNumber
        Rotation number whose convergents determine the orbits.

    Returns
    -------
    dict
        "at": the values of s; "residue": the residues, NaN where no orbit is found; both are lists
        of lists, one list for each orbit. "orbit": the names p/q of the orbits.
    """
    minimax = action.ConvergentOrbits(start, profile, distinct_convergents(omega, _MAX_Q))
    at, names = np.linspace(0, 1, PLACES + 1), [f"{one.p}/{one.q}" for one in minimax.chains]
    first = max(0, len(names) - _N_RESIDUES)
    values = np.full((len(names) - first, at.size), np.nan)
    for n, i in np.ndindex(values.shape):
        with suppress(action.LostError):
            values[n, i] = minimax.at(first + n, float(at[i]), -1).residue
    return {"at": [at.tolist()] * len(values), "residue": values.tolist(), "orbit": names[first:]}
