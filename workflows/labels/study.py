"""Forcings with proved answers, what proves them, and the score of indicators against them."""

import hashlib
from fractions import Fraction
from functools import cache
from itertools import pairwise

import numpy as np
import xarray as xr

from nasm.barriers import critical_scale
from nasm.proofs import cells as proved_cells
from nasm.symmetries import ray
from pipeline import store
from pipeline.cubes import proved
from pipeline.cubes.cube import flags, text
from pipeline.cubes.indicators import INDICATORS, indicators, kicks_of
from pipeline.store.tiles import COMMIT, arrays_of
from workflows.shared.judgement import finding
from workflows.shared.tables import dataset, described

BARRIER, TRANSPORT = 1, 2
TRAIN, TEST = 1, 2
_LABELS = flags(["barrier", "transport"])
_SPLITS = flags(["train", "test"])
_LARGER_IS_BARRIER = {"escape": True, "digits": True, "exponent": False, "fli": False}

_VALUES = {
    "escape": "first step at which an orbit has escaped; inf if none has within n",
    "digits": "most digits of the Birkhoff average on a rotational orbit; 0 if there is none",
    "exponent": "smallest finite-time Lyapunov exponent of a rotational orbit; inf if none",
    "fli": "smallest fast Lyapunov indicator of a rotational orbit; inf if none",
}


def angles(n_rays, seed):
    """Return random directions, in degrees, one in each of n_rays equal parts of 0° to 45°."""
    random = np.random.default_rng([seed, 0])
    return 45 * (np.arange(n_rays) + random.random(n_rays)) / n_rays


def drawn(rays, margins, seed):
    """Draw forcings κ = (1 + margin)·κ_c on rays: one for each class of margins on either side.

    Margins are log-uniform within a class. kappa1 ≥ kappa2 ≥ 0; `image` numbers the symmetry of the
    plane that takes the forcing to the one whose indicators are computed.

    Parameters
    ----------
    rays : xr.Dataset
        The last barriers, dim (angle); rays without an answer have no forcings.
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

    The rule is stable, and applies to forcings outside this data set too: images of a forcing under
    the symmetries of the plane belong to the same split.
    """
    strengths = " ".join(strength.hex() for strength in canonical(float(kappa1), float(kappa2)))
    return TEST if hashlib.sha256(strengths.encode()).digest()[0] & 128 else TRAIN


def planned(n_rays, margins, n_max, sizes):
    """Return the jobs that follow, planned for forcings on the ray (1, 0)."""
    last = critical_scale((1.0, 0.0), 0.1)
    on_ray = {"critical_scale": last.value, "error": last.error, "circle": str(last.omega)}
    columns = {name: ("angle", np.array(n_rays * [value])) for name, value in on_ray.items()}
    guess = drawn(xr.Dataset(columns, {"angle": np.zeros(n_rays)}), margins, 0)
    return [own_proofs(guess, {}), indicators_of(guess, n_max, sizes)]


def own_proofs(forcings, sources):
    """Return the job of proofs for the forcings that have no source yet; None if all have one."""
    rest = forcings.isel(forcing=[i for i in range(forcings.forcing.size) if i not in sources])
    rows = np.stack([rest.kappa1, rest.kappa2, rest.margin], -1).tolist()
    return proved.proved_forcings("labels_proofs", rows, rest.circle.values) if rows else None


def indicators_of(forcings, n_max, sizes):
    """Return the job of the indicators of the forcings' images; sizes : IndicatorSettings."""
    return indicators("labels_indicators", *images(forcings), n_max, sizes)


def in_map(place, cells, triangles, forcings):
    """Find the certificates of the proved map whose region contains a forcing.

    All comparisons are exact, so that the certificate proves the answer for these floats.

    Returns
    -------
    dict of int to (label, certificate, file)
        By the number of the forcing: the answer, the SHA-256 of the certificate, and its file.
    """
    found, width = {}, cells.sizes["kappa1"] // proved.BLOCKS  # cells along a side of a tile
    patches = _patches(place, triangles.sizes["triangle"])

    @cache
    def squares(key):
        return [_square(each) for each in proved.unpack_certificates(place.read(key))]

    for i, (kappa1, kappa2, margin) in enumerate(_rows(forcings)):
        if margin > 0:
            column, row = (int(kappa * cells.attrs["cells"]) for kappa in (kappa1, kappa2))
            if max(column, row) >= cells.sizes["kappa1"]:
                continue
            if int(cells.proved[row, column]) == proved_cells.TRANSPORT:
                key = store.certificates_key("proved_map", (row // width, column // width))
                known = (name for name, covers in squares(key) if covers(kappa1, kappa2))
                if name := next(known, None):
                    found[i] = TRANSPORT, name, key
        else:
            known = (each for each in patches if each[2](kappa1, kappa2))
            if patch := next(known, None):
                found[i] = BARRIER, *patch[:2]
    return found


def _rows(forcings):
    return np.stack([forcings.kappa1, forcings.kappa2, forcings.margin], -1).tolist()


def _square(certificate):
    """Return the name of a cell's certificate, and the test whether a forcing is in the cell."""
    centre, half = (proved.floats_of(certificate, name) for name in ("kappa", "half_width"))
    ends = [
        (Fraction(middle) - Fraction(width), Fraction(middle) + Fraction(width))
        for middle, width in zip(centre, half, strict=True)
    ]

    def covers(*kappa):
        return all(low <= k <= high for k, (low, high) in zip(kappa, ends, strict=True))

    return certificate["sha256"], covers


def _patches(place, n):
    """List the name, the file, and the test for a forcing, of every certificate of a triangle."""
    keys = [store.certificates_key("proved_triangles", (i,)) for i in range(n)]
    return [
        (each["sha256"], key, _patch(each))
        for key in keys
        for each in proved.unpack_certificates(place.read(key))
    ]


def _patch(certificate):
    """Return the test whether κ = s(a + tb) with |t| ≤ 1 and s between the scales of the patch."""
    names = "kappa", "tilt", "scales"
    a, b, (low, high) = (
        [Fraction(number) for number in proved.floats_of(certificate, name)] for name in names
    )
    determinant = a[0] * b[1] - a[1] * b[0]

    def covers(*kappa):
        k = [Fraction(strength) for strength in kappa]
        s = (k[0] * b[1] - k[1] * b[0]) / determinant
        st = (a[0] * k[1] - a[1] * k[0]) / determinant
        return low <= s <= high and abs(st) <= s

    return covers


def by_own_proofs(place, job, sources):
    """Return the sources, as `in_map` does, of the forcings with proofs of their own."""
    cube, found = store.read(place, job.cube.name).load(), {}
    total = cube.sizes["forcing"] + len(sources)
    numbers = [i for i in range(total) if i not in sources]
    for tile, number in enumerate(numbers):
        label = {proved.BARRIER: BARRIER, proved_cells.TRANSPORT: TRANSPORT}
        if answer := label.get(int(cube.proved[tile])):
            key = store.certificates_key(job.cube.name, (tile,))
            (certificate,) = proved.unpack_certificates(place.read(key))
            found[number] = answer, certificate["sha256"], key
    return found


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
        "margin": (on, rows.margin.values, "κ over the forcing at the last breakup, minus 1"),
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


def threshold(values, is_barrier, larger_is_barrier):
    """Choose the value from which on to answer BARRIER, and return its score.

    Of all values, the threshold is the one for which the share of false BARRIER plus that of false
    TRANSPORT is smallest; of equally good ones, the middle one. NaN without forcings of both kinds.

    Parameters
    ----------
    values : ndarray
        Values of the indicator for the forcings of the split `train`.
    is_barrier : ndarray of bool
        Proved answers.
    larger_is_barrier : bool
        True if large values mean BARRIER.
    """
    if is_barrier.all() or not is_barrier.any():
        return np.nan
    score = values if larger_is_barrier else -values
    candidates = np.unique(score)
    below = np.array([np.mean(score[is_barrier] < c) for c in candidates])
    above = np.array([np.mean(score[~is_barrier] >= c) for c in candidates])
    best = np.flatnonzero(below + above <= (below + above).min() + 1e-12)
    chosen = candidates[best[best.size // 2]]
    return chosen if larger_is_barrier else -chosen


def answers_barrier(values, limit, larger_is_barrier):
    """Return True where an indicator answers BARRIER."""
    return values >= limit if larger_is_barrier else values <= limit


def wilson(k, n, z=1.96):
    """Return the 95% interval of Wilson for a share of k in n; NaN for n = 0."""
    k, n = np.asarray(k, float), np.where(np.asarray(n) > 0, n, np.nan)
    share, spread = k / n, z * np.sqrt(k * (n - k) / n + z**2 / 4) / n
    centre = (share + z**2 / (2 * n)) / (1 + z**2 / n)
    half = spread / (1 + z**2 / n)
    return centre - half, centre + half


def share_of(counts):
    """Return the share of false answers; NaN where there are no forcings."""
    return np.where(counts.n_test > 0, counts.n_false / np.maximum(counts.n_test, 1), np.nan)


def scores(labels, margins):
    """Count false answers on the split `test`, by indicator, number of steps and class of margins.

    Dims (indicator, n, side, margin_class). A false answer below CB_gt is TRANSPORT, beyond it
    BARRIER.
    """
    is_barrier = labels.label.values == BARRIER
    train, test = (labels.split.values == part for part in (TRAIN, TEST))
    classes = np.digitize(np.abs(labels.margin.values), margins) - 1
    groups = [[(is_barrier == side) & (classes == c) for c in range(len(margins) - 1)]
              for side in (True, False)]  # fmt: skip
    settings = {name: labels.attrs[name] for name in ("n_orbits", "n_starts")}
    shape = len(INDICATORS), labels.n.size
    limits, kicks = np.full((2, *shape), np.nan)
    false, total = np.zeros((2, *shape, 2, len(margins) - 1), int)
    for i, j in np.ndindex(shape):
        name, n = INDICATORS[i], int(labels.n[j])
        values, larger = labels[name].values[:, j], _LARGER_IS_BARRIER[name]
        kicks[i, j] = kicks_of(name, values, n, settings).mean()
        limit = np.inf
        if name != "escape":
            limit = threshold(values[train], is_barrier[train], larger)
        if np.isnan(limit):
            continue
        limits[i, j] = limit
        wrong = answers_barrier(values, limit, larger) != is_barrier
        false[i, j] = [[np.sum(wrong & test & group) for group in row] for row in groups]
        total[i, j] = [[np.sum(test & group) for group in row] for row in groups]
    dims = "indicator", "n", "side", "margin_class"
    low, high = wilson(false, total)
    counts = xr.Dataset({"n_false": (dims, false), "n_test": (dims, total)})
    variables = {
        "share": (dims, share_of(counts), "share of false answers on the split test"),
        "least": (dims, low, "lower end of its 95% interval (Wilson)"),
        "most": (dims, high, "upper end of its 95% interval (Wilson)"),
        "n_false": (dims, false, "false answers"),
        "n_test": (dims, total, "forcings of the split test"),
        "threshold": (
            dims[:2],
            limits,
            "value from which on the answer is BARRIER",
        ),
        "kicks": (dims[:2], kicks, "kicks of all orbits per forcing, mean"),
    }
    coords = {
        "indicator": text("indicator", INDICATORS, "indicator"),
        "n": labels.n,
        "side": text("side", ["below", "beyond"], "side of CB_gt: barrier below, transport beyond"),
        "margin_class": (np.arange(len(margins) - 1), "class of margins"),
        "margin_low": ("margin_class", margins[:-1], described("smallest margin of the class")),
        "margin_high": ("margin_class", margins[1:], described("largest margin of the class")),
    }
    flat = {name: coords.pop(name) for name in ("margin_low", "margin_high")}
    cube = dataset("False answers of indicators of transport", coords, variables)
    return cube.assign_coords(flat).assign_attrs(
        n_train=int(train.sum()), n_test=int(test.sum()), unlabelled=_unlabelled(labels)
    )


def seconds(place, values, scores):
    """Return the CPU seconds of each indicator per forcing, dims (indicator, n).

    The CPU time of the sweep, which is kept in the records of its tiles, is divided among the
    numbers of steps in proportion to the kicks.
    """
    spent = np.asarray(arrays_of(place, "labels_indicators")[COMMIT][0])
    per_forcing = xr.DataArray(spent.sum(axis=(1, *range(2, spent.ndim))), dims="indicator")
    per_forcing = per_forcing / values.sizes["forcing"]
    share = scores.kicks / scores.kicks.sum("n")
    label = "CPU seconds per forcing, in proportion to the kicks"
    return (share * per_forcing).assign_attrs(described(label, "s"))


def _unlabelled(labels):
    drawn = labels.attrs["drawn_below"] + labels.attrs["drawn_beyond"]
    return drawn - labels.sizes["forcing"]


_DECIDED = 0.05
"""An indicator errs if the 95% interval of its share lies above this, and is right if below."""

_ERRS = {
    "escape": {"beyond"},
    "digits": {"below"},
    "exponent": {"below", "beyond"},
    "fli": {"below", "beyond"},
}
"""The sides of CB_gt on which the first claim has each indicator err."""


def findings(scores, seconds):
    """Judge two claims about the indicators, and state the limits; return lines of text."""
    limits = (
        f"Limits: {scores.attrs['unlabelled']} forcings drawn without a proved answer are left "
        f"out, and so is everything closer to CB_gt than {100 * float(scores.margin_low[0]):g}%; "
        "thresholds depend on how the margins are distributed, and the indicators of orbits on "
        "the line and the number of its starts."
    )
    return "\n".join([_where_they_err(scores.isel(n=-1)), _next_to_it(scores, seconds), limits])


def _where_they_err(last):
    """Judge on which sides of CB_gt each indicator errs after the largest number of steps."""
    sums = last[["n_false", "n_test"]].sum("margin_class")
    share, least, most = (
        xr.DataArray(values, sums.n_test.coords)
        for values in (share_of(sums), *wilson(sums.n_false, sums.n_test))
    )
    errs, is_right = least > _DECIDED, most < _DECIDED
    parts, holds = [], []
    for name in last.indicator.values:
        sides = []
        for side in last.side.values:
            one = {"indicator": name, "side": side}
            claimed = errs if side in _ERRS[name] else is_right
            holds.append(bool(claimed.sel(one)))
            sides.append(f"{100 * float(share.sel(one)):.0f}% {side} ({_reach(last.sel(one))})")
        parts.append(f"{name} {', '.join(sides)}")
    known = bool((wilson(0, sums.n_test)[1] < _DECIDED).all())
    text = (
        f"after {int(last.n)} steps the shares of false answers on either side of CB_gt, and the "
        f"margins without one, are: {'; '.join(parts)}"
    )
    claim = (
        "an escape errs beyond CB_gt only, the Birkhoff average below it only, and Lyapunov "
        "indicators on both sides"
    )
    every = bool(errs.any("side").all())
    return finding(claim, text, all(holds), every and holds[0], known)


def _reach(one):
    """Say from which margin on there are no false answers."""
    right = (one.n_false.values == 0)[::-1].cumprod()[::-1].astype(bool)
    if not right.any():
        return "nowhere"
    return f"from {100 * float(one.margin_low.values[right][0]):g}% on"


def _next_to_it(scores, seconds):
    """Judge whether every indicator errs in the nearest class, and find the one that errs least."""
    nearest, sums = scores.isel(margin_class=0), scores[["n_false", "n_test"]]
    sums = sums.sum(["side", "margin_class"])
    errs = (nearest.least > _DECIDED).any("side").values
    share, known = share_of(sums), bool((nearest.n_test > 9).all())
    (i, j), ends = (
        np.unravel_index(np.argmin(share), share.shape),
        wilson(sums.n_false, sums.n_test),
    )
    low, high = (100 * end[i, j] for end in ends)
    text = (
        f"next to CB_gt {int(errs.sum())} of {errs.size} do, each on one side at least; the fewest "
        f"false answers in all classes, {100 * share[i, j]:.0f}% ({low:.0f} to {high:.0f}%), has "
        f"{scores.indicator.values[i]} after {int(scores.n[j])} steps, in "
        f"{float(seconds[i, j]):.2g} CPU seconds per forcing, and {100 * share[i, -1]:.0f}% after "
        f"{int(scores.n[-1])} steps, in {float(seconds[i, -1]):.2g} s; always to answer BARRIER "
        f"has {100 * _of_one_answer(scores):.0f}%"
    )
    margin = 100 * float(scores.margin_high[0])
    claim = f"within {margin:g}% of CB_gt every indicator errs, whatever the number of steps"
    return finding(claim, text, bool(errs.all()), bool(errs[:, -1].all()), known)


def _of_one_answer(scores):
    """Return the share of false answers of one who always answers BARRIER."""
    total = scores.n_test.isel(indicator=0, n=0)
    return float(total.sel(side="beyond").sum() / total.sum())
