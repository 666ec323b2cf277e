"""Orbits of T_{κ1κ2} and of the nonautonomous map, x and y mod 1, as labelled Datasets."""

import numpy as np

from nasm import orbits
from nasm.symmetries import alternate, negate
from workflows.shared.tables import dataset, strengths

_SECTIONS = "arXiv:1606.04824, Sec."
FORCING = (0.35, 0.5)
ISLAND = (0.0, 0.55)  # Fig. 1(d): a start in the island around (0, 1/2)
SYMMETRIC_FORCING = (0.5, 0.7)
# Fig. 2: starts in the island around (1/2, 0), the island chain with ω = 2/3, and the island around
# (0, 1/2).
MARKED = ((0.5, 0.12), (0.5, 0.36), (0.0, 0.44))


def nonautonomous_dataset(n_orbits, n_max):
    """Iterate T_{κ1κ2}, T_{κ2κ1} and the nonautonomous map from the same starts.

    The Dataset contains x, y with dims (forcing, step, orbit); kick_x, kick_y (kick, orbit); and
    island_x, island_y (kick) of one orbit in an island.
    """
    forcings = np.array([FORCING, FORCING[::-1]])
    x, y = np.stack([orbits.portrait(kappa, n_orbits, n_max) for kappa in forcings], axis=1)
    kicked = orbits.orbit(FORCING, x[0, 0], y[0, 0], n_max, 1)
    island = orbits.orbit(FORCING, *ISLAND, n_max, 1)
    coords = {
        "forcing": (range(2), "forcing"),
        "step": (range(n_max + 1), "steps of two kicks"),
        "kick": (range(n_max + 1), "kicks of the first forcing"),
        "orbit": (range(n_orbits), "orbit"),
    }
    variables = (
        strengths("forcing", *forcings.T)
        | _points("", ("forcing", "step", "orbit"), x, y)
        | _points("kick_", ("kick", "orbit"), *kicked)
        | _points("island_", ("kick",), *island)
    )
    title, references = "Orbits of T and of the nonautonomous map", f"{_SECTIONS} II and Fig. 1"
    return dataset(title, coords, variables, {"references": references})


def images(kappa, x, y):
    """Return (κ, x, y) and its images under the symmetries, in the order of Fig. 2.

    The images are those under `negate`, under both symmetries, and under `alternate`.
    """
    alternated = alternate(kappa, x, y)
    return [(kappa, x, y), negate(kappa, x, y), negate(*alternated), alternated]


def symmetric_dataset(n_orbits, n_max):
    """Iterate T under four forcings related by symmetry.

    The Dataset contains x, y with dims (forcing, step, orbit); marked_x, marked_y (forcing, step,
    marked); and `difference`. For each forcing this is the largest distance between its marked
    orbits and the images, under a symmetry, of the marked orbits of the first forcing.
    """

    def iterated(x, y):
        starts = images(SYMMETRIC_FORCING, x, y)
        return np.stack([orbits.orbit(*start, n_max) for start in starts], axis=1)

    starts = orbits.portrait(SYMMETRIC_FORCING, n_orbits, 0)
    marked = iterated(*np.transpose(MARKED))
    ideal = images(SYMMETRIC_FORCING, *marked[:, 0])
    apart = marked - np.stack([points for _, *points in ideal], axis=1)
    apart = np.abs(apart - np.rint(apart)).max(axis=(0, 2, 3))
    words = "largest distance, mod 1, from the images of the marked orbits of the first forcing"
    coords = {
        "forcing": (range(4), "forcing"),
        "step": (range(n_max + 1), "steps of two kicks"),
        "orbit": (range(n_orbits), "orbit"),
        "marked": (range(len(MARKED)), "marked orbit"),
    }
    variables = {
        **strengths("forcing", *np.transpose([kappa for kappa, *_ in ideal])),
        **_points("", ("forcing", "step", "orbit"), *iterated(*(at[0] for at in starts))),
        **_points("marked_", ("forcing", "step", "marked"), *marked),
        "difference": ("forcing", apart, words),
    }
    references = {"references": f"{_SECTIONS} III.A and Fig. 2"}
    return dataset("Symmetric orbits of T", coords, variables, references)


def _points(prefix, dims, x, y):
    return {f"{prefix}x": (dims, x % 1.0, "x mod 1"), f"{prefix}y": (dims, y % 1.0, "y mod 1")}
