"""Forcings with proved answers: their random choice, the train/test split, and the data set."""

import hashlib
from itertools import pairwise

import numpy as np
import xarray as xr

from nasm.barriers import critical_scale
from nasm.symmetries import ray
from pipeline.cubes import proved
from pipeline.cubes.cube import flags, text
from pipeline.cubes.indicators import indicators
from workflows.shared.tables import dataset, described

BARRIER, TRANSPORT = 1, 2
TRAIN, TEST = 1, 2
_LABELS = flags(["barrier", "transport"])
_SPLITS = flags(["train", "test"])

_VALUES = {
    "escape": "first step at which an orbit has escaped; inf if none has within n",
    "digits": "largest number of digits of the Birkhoff average on a rotational orbit; 0 if none",
    "exponent": "smallest finite-time Lyapunov exponent of a rotational orbit; inf if none",
    "fli": "smallest fast Lyapunov indicator of a rotational orbit; inf if none",
}


def angles(n_rays, seed):
    """Return random directions, in degrees: one in each of n_rays equal parts of [0°, 45°]."""
    random = np.random.default_rng([seed, 0])
    return 45 * (np.arange(n_rays) + random.random(n_rays)) / n_rays


def drawn(rays, margins, seed):
    """Draw forcings κ = (1 + margin)·κ_c on rays: one per class of margins on each side of κ_c.

    Margins are log-uniform within a class. kappa1 ≥ kappa2 ≥ 0; `image` is the index of the
    symmetry that maps the forcing to the image whose indicators are computed.

    Parameters
    ----------
    rays : xr.Dataset
        The last barriers, dim (angle); rays without a critical scale get no forcings.
    margins : list of float
        Ends of the classes.
    seed : int
        Seed of the random numbers.
    """
    random, rows = np.random.default_rng([seed, 1]), []
    for i, angle in enumerate(rays.angle.values):
        value, error = float(rays.critical_scale[i]), float(rays.error[i])
        for low, high in pairwise(margins):
            for side in (-1, 1):
                margin = side * low * (high / low) ** random.random()
                image = int(8 * random.random())
                kappa1, kappa2 = ((1 + margin) * value * ray(angle)).tolist()
                uncertainty = (1 + margin) * error / value
                if value > 0:
                    circle = str(rays.circle.values[i])
                    rows.append((kappa1, kappa2, margin, uncertainty, circle, image))
    names = "kappa1", "kappa2", "margin", "margin_error", "circle", "image"
    columns = {
        name: ("forcing", np.array(column))
        for name, column in zip(names, zip(*rows, strict=True), strict=True)
    }
    return xr.Dataset(columns, {"forcing": np.arange(len(rows))})


def images(forcings):
    """Return κ1 and κ2 of the images of the drawn forcings under their symmetries."""
    image = forcings.image.values
    both = np.stack([forcings.kappa1.values, forcings.kappa2.values])
    both = np.where(image & 4, both[::-1], both)
    return both * np.where([image & 1, image & 2], -1, 1)


def canonical(kappa1, kappa2):
    """Return the image of a forcing with κ1 ≥ κ2 ≥ 0; all eight images have the same one."""
    return max(abs(kappa1), abs(kappa2)), min(abs(kappa1), abs(kappa2))


def split_of(kappa1, kappa2):
    """Return TRAIN or TEST, from the first bit of the SHA-256 of the canonical image's strengths.

    The rule is stable, and applies outside this data set too. Images of a forcing under the
    symmetries of the plane belong to the same split.
    """
    strengths = " ".join(strength.hex() for strength in canonical(float(kappa1), float(kappa2)))
    return TEST if hashlib.sha256(strengths.encode()).digest()[0] & 128 else TRAIN


def planned(n_rays, margins, n_max, sizes):
    """Return jobs that cost about as much as the later ones, for forcings on the ray (1, 0)."""
    last = critical_scale((1.0, 0.0), 0.1)
    on_ray = {"critical_scale": last.value, "error": last.error, "circle": str(last.omega)}
    columns = {name: ("angle", np.array(n_rays * [value])) for name, value in on_ray.items()}
    guess = drawn(xr.Dataset(columns, {"angle": np.zeros(n_rays)}), margins, 0)
    return [own_proofs(guess, {}), indicators_of(guess, n_max, sizes)]


def own_proofs(forcings, sources):
    """Return the proof job for the forcings that have no source yet; None if all have one."""
    rest = forcings.isel(forcing=[i for i in range(forcings.forcing.size) if i not in sources])
    rows = np.stack([rest.kappa1, rest.kappa2, rest.margin], -1).tolist()
    return proved.proved_forcings("labels_proofs", rows, rest.circle.values) if rows else None


def indicators_of(forcings, n_max, sizes):
    """Return the job that computes indicators of the images; sizes : IndicatorSettings."""
    return indicators("labels_indicators", *images(forcings), n_max, sizes)


def labelled(forcings, sources, values):
    """Return the data set of the forcings whose answers are proved, dims (forcing, n).

    forcings, sources : as returned by `drawn` and `in_map`. values : the cube of indicators.
    """
    chosen = sorted(sources)
    rows, of_rows = forcings.isel(forcing=chosen), values.isel(forcing=chosen)
    answers, names, files = zip(*(sources[i] for i in chosen), strict=True)
    strengths = of_rows.kappa1.values, of_rows.kappa2.values
    splits = [split_of(*pair) for pair in zip(*strengths, strict=True)]
    on = "forcing"
    variables = {
        "label": (on, np.array(answers, np.int8), described("proved answer", **_LABELS)),
        "kappa1": (on, strengths[0], "strength of the first kick"),
        "kappa2": (on, strengths[1], "strength of the second kick"),
        "margin": (on, rows.margin.values, "κ/κ_c - 1; the last circle breaks at κ_c"),
        "margin_error": (on, rows.margin_error.values, "error of margin"),
        "split": (on, np.array(splits, np.int8), described("part of the data", **_SPLITS)),
        "certificate": text(on, names, "SHA-256 in the certificate of the proof"),
        "certificate_file": text(on, files, "file that contains the certificate"),
    }
    for name, label in _VALUES.items():
        variables[name] = (on, "n"), of_rows.value.sel(indicator=name).values, label
    title = "Forcings of two kicks with proved answers, and indicators of transport"
    sides = {side: int(np.sum(np.sign(forcings.margin) == side)) for side in (-1, 1)}
    attrs = {"drawn_below": sides[-1], "drawn_beyond": sides[1]}
    attrs |= {name: int(values.attrs[name]) for name in ("n_orbits", "n_starts")}
    coords = {"forcing": (np.array(chosen), "number of the forcing"), "n": values.n}
    return dataset(title, coords, variables, attrs)
