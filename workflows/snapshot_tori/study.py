"""When snapshot tori fold, are excluded as graphs, and begin to stretch, as kicks grow stronger.

The ensemble-averaged pairwise distance (EAPD) of a torus is defined in `nasm.snapshot`.
"""

from dataclasses import dataclass

import numpy as np

from nasm import snapshot
from nasm.barriers import critical_scale
from nasm.circles import graph, invariant_circle
from nasm.converse_kam import aperiodic
from nasm.orbits import rotation_number
from workflows.shared.judgement import finding, span
from workflows.shared.ramps import lost
from workflows.shared.tables import columns, dataset

QUANTILES = 0.1, 0.5, 0.9
EVENTS = {
    "folded": "kicks from κ_G until the torus is no longer a graph",
    "excluded": "kicks from κ_G until converse KAM excludes all graphs through one of its points",
    "exceeds": "kicks from κ_G until the EAPD exceeds that of any graph",
    "onset": "kicks from κ_G until distances exceed those on any graph by `factor`, for good",
    "stretched": "kicks from κ_G until half of the orbits are stretched by more than n² for good",
    "share": "fraction of the orbits that have separated at the onset",
    "slope": "mean slope of the EAPD from the onset to the end of the ramp, per kick",
}


@dataclass(frozen=True)
class Settings:
    """The ramps, the tori of the initial map, and how they are sampled.

    Attributes
    ----------
    first, last : float
        κ before and at the first kick of a ramp, and κ at its last kick. At 0.5 the golden circle
        and many others exist; at 1.5 all are broken.
    n_starts : int
        Number of tori besides the golden one. They cross x = 1/2 at equally spaced y from 0 to 1/2;
        symmetries map these tori to those at other y. Starts of chaotic orbits are left out.
    n_points : int
        Points on each torus. With 128 to 1024 points, the onsets on five tori differ by less than
        0.003 in κ, for r from 10⁻² to 10⁻⁴.
    n_averaged : int
        Number of steps over which ω of a torus is averaged.
    factor : float
        The onset is the kick from which the mean distance on a torus exceeds its bound for graphs
        by more than this factor, until the end of the ramp.
    n_samples : int
        Number of samples of the EAPD and the exponents kept for one ramp.
    """

    first: float = 0.5
    last: float = 1.5
    n_starts: int = 16
    n_points: int = 256
    n_averaged: int = 10_000
    factor: float = 10.0
    n_samples: int = 200


DEFAULT = Settings()


def snapshots(rates, kept, settings=DEFAULT):
    """Follow the tori through ramps κ_n = 0.5 + r·n; return a Dataset with dims start and rate.

    Parameters
    ----------
    rates : ndarray
        Growth r of κ per kick, at most 0.01, so that all kicks that `lost` uses to exclude graphs
        belong to the ramp.
    kept : float
        The EAPD and exponents of the ramp with the rate nearest to this one are kept, with the dims
        start and kick.
    settings : Settings
        The ramps and the tori.

    Returns
    -------
    xarray.Dataset
        Kicks are counted from the first one with κ ≥ κ_G.
    """
    critical = critical_scale((1.0,), 1e-4).value
    starts = list(_starts(settings))
    tori = [snapshot.torus(settings.first, y, settings.n_points) for y, _ in starts]
    events, excluded = [], []
    kept = rates[np.abs(rates - kept).argmin()]
    for rate in rates:
        n = np.arange(round((settings.last - settings.first) / rate) + 1)
        kappa = settings.first + rate * n
        zero = int((kappa < critical).sum())
        every = max(1, n.size // settings.n_samples)
        followed = [snapshot.separations(kappa, *torus, every) for torus in tori]
        pairs = zip(tori, followed, strict=True)
        events.append([_events(kappa, *pair, zero, settings.factor) for pair in pairs])
        excluded.append(lost(kappa[zero], rate))
        if rate == kept:
            sampled = slice(None, None, every)
            kick, strengths = n[sampled] - zero, kappa[sampled]
            bound = snapshot.graph_bound(strengths)
            distance = np.array([each.distance[sampled] for each in followed])
            exponents = np.quantile([each.exponents for each in followed], QUANTILES, axis=-1)
    y, omega = np.transpose(starts)
    winds = np.array([(u > 0).all() for _, _, u, _ in tori], np.int8)
    return dataset(
        "Snapshot tori in ramps",
        {
            "start": (np.arange(y.size), "torus of the initial map; 0 is the golden circle"),
            "rate": (rates, "growth of κ per kick"),
            "kick": (kick, "kicks from κ_G"),
            "quantile": (np.array(QUANTILES), "fraction of the orbits with a smaller exponent"),
        },
        {
            "y": ("start", y, "y of the torus at x = 1/2, in turns"),
            "omega": ("start", omega, "rotation number of the torus"),
            "winds": ("start", winds, "1 if the torus winds around the cylinder; 0 in islands"),
            "lost": ("rate", np.array(excluded), "kicks from κ_G until all graphs are excluded"),
            **columns(("start", "rate"), EVENTS, np.moveaxis(events, 2, 0).swapaxes(1, 2)),
            "strength": ("kick", strengths, "κ of the kick"),
            "bound": ("kick", bound, "largest EAPD of a graph"),
            "distance": (("start", "kick"), distance, "EAPD of the torus"),
            "exponent": (("quantile", "start", "kick"), exponents, "λ_n, per kick"),
        },
        {
            "critical_scale": critical,
            "kept_rate": kept,
            "last": settings.last,
            "factor": settings.factor,
        },
    )  # fmt: skip


def _starts(settings):
    """Yield (y, ω) of tori that cross x = 1/2 at y: first the golden circle, then others."""
    _, y = graph(invariant_circle("[0;2,(1)]", settings.first))
    golden = y[y.size // 2]  # θ = x = 1/2, by symmetry
    grid = (np.arange(settings.n_starts) + 0.5) / (2 * settings.n_starts)
    for y in (golden, *grid):
        omega, _ = rotation_number(settings.first, 0.5, y, settings.n_averaged)
        if np.isfinite(omega):
            yield y, omega


def _events(kappa, torus, followed, zero, factor):
    """Return the values of EVENTS for one torus in one ramp."""
    past = np.full(kappa.size, kappa[0])  # the curve is invariant before the ramp begins
    times = aperiodic.elimination_time(np.r_[past, kappa], 0.0, past.size, *torus[:2])
    beyond = followed.distance - snapshot.graph_bound(kappa)
    exceeds = _first(beyond > 0)
    onset = _first(np.flip(np.logical_and.accumulate(np.flip(beyond > np.log(factor)))))
    share = slope = np.nan
    if np.isfinite(onset):
        share = (followed.separated <= onset).mean()
        n = int(onset)
        slope = (followed.distance[-1] - followed.distance[n]) / max(1, kappa.size - 1 - n)
    kicks = [followed.folded.min(), times.min(), exceeds, onset, np.median(followed.stretched)]
    return [*(kick - zero for kick in kicks), share, slope]


def _first(true):
    """Return the index of the first True; inf if there is none."""
    return float(true.argmax()) if true.any() else np.inf


def findings(cube):
    """Judge what the EAPD of a torus implies for graphs and orbits; return lines of text."""
    winding, island = (cube.sel(start=cube.start[cube.winds == value]) for value in (1, 0))
    lag = (winding.exceeds - winding.excluded).values.ravel()
    early = winding.lost - winding.onset  # kicks from the onset to the exclusion of all graphs
    before, after = (early > 0).values, (early < 0).values
    silent = np.isinf(island.onset.values)
    share = cube.share.values[np.isfinite(cube.share.values)]
    fold = (winding.excluded - winding.folded).values
    pairs = f"{lag.size} pairs of a winding torus and a ramp"
    ends = f"{float(cube.rate.max()):.0e} to {float(cube.rate.min()):.0e}"
    return "\n".join([
        finding(
            "the EAPD of a torus exceeds that of a graph only after converse KAM excludes the "
            "graphs through one of its points",
            f"it does so later in {int((lag > 0).sum())} of {pairs} (r from {ends}); the delay is "
            f"{span(lag, '.0f')} kicks, with a median of {np.median(lag):.0f}; the exclusion "
            f"follows the first fold of the torus after a median of {np.median(fold):.0f} kicks",
            bool((lag > 0).all()),
            float((lag > 0).mean()) > 0.9,
            lag.size > 0,
        ),
        finding(
            "an onset, or the absence of one, does not show whether graphs exist",
            f"the onset precedes the exclusion of all graphs in {int(before.sum())} of {pairs}, by "
            f"up to {float(early.max()):.0f} kicks, and follows it in {int(after.sum())}; of "
            f"{silent.size} pairs of a ramp and an island torus, through which no graph passes, "
            f"{int(silent.sum())} show no onset up to κ = {cube.attrs['last']:g}",
            bool(before.any() and after.any() and silent.any()),
            bool(before.any() or silent.any()),
            lag.size > 0 and silent.size > 0,
        ),
        finding(
            "at its onset the EAPD is representative of most orbits of the torus",
            f"{span(share, '.0%')} of them have separated, at least half in "
            f"{int((share >= 0.5).sum())} of {share.size} pairs with an onset",
            bool((share >= 0.5).all()),
            float((share >= 0.5).mean()) > 0.5,
            share.size > 0,
        ),
        "No orbit crosses a torus, even a folded one, because every torus is the image of an "
        "invariant curve. The EAPD and the exclusion of graphs therefore do not show transport. "
        "Distances are linearised, exponents are those of the two-dimensional map, and tori are "
        "sampled. Not studied: decreasing ramps, maps without twist.",
    ])  # fmt: skip
