"""Converse KAM for kicks that never repeat: for how many of them may a curve stay a graph?

κ_0, …, κ_{N-1} are any N kicks, of a forcing that is quasi-periodic, decays, drifts or is noise.
A rotational curve always has images under them; there is no invariant curve to ask for. What is
ruled out here is a curve that *stays a graph* y = g_n(x) before each kick n of a piece of them.

What is proved, given exact arithmetic and all starts instead of a sample. If all starts of a
transversal before kick c are eliminated within K kicks in either direction (`nasm.transversals`),
then no rotational curve stays a graph before all of the kicks c - K, …, c + K.

1. If γ_n and γ_{n+1} are graphs, the kick takes x to x' homeomorphically and keeps the orientation:
   orbits on them keep their order. Distances of neighbours, normalised by the largest of the piece,
   have a limit ξ_n ≥ 0 that solves the linearised chain and is not 0 everywhere. ξ_n = 0 inside the
   piece would make its neighbours opposite, so both 0, and so on: ξ_n > 0 there.
2. With that ξ the criterion of `nasm.transversals` follows; it looks at 2K kicks, no more.
3. γ_c crosses the transversal. So one kick c is enough, and no start is left for γ_c.

For the rotating standard map with irrational Ω: an invariant torus that is a graph over (x, φ) is
such a curve for each phase and for all kicks. One eliminated piece of one phase rules out all of
these tori.

What is only measured. For a periodic forcing, Birkhoff's theorem makes every invariant rotational
circle a graph, so none is left. For a sequence nothing does: a curve that some kicks fold may be
unfolded by others, and keep orbits apart all the same. So no statement of global transport follows
from a life that ends; `nasm.escape` and `nasm.orbits` see whether orbits do get across. Starts are
a sample, arithmetic is floating point, and a search may miss a survivor.
"""

from itertools import product
from math import inf

import numpy as np

from nasm import transversals
from nasm.checks import count
from nasm.maps import forcing
from nasm.transversals import Transversal

_BENDS = 0.0, -0.1, 0.1  # c_1 of the transversals tried, for a = 0 and 1/2


def elimination_times(kappa, n_kicks, sites=None):
    """The kicks in either direction within which no curve can stay a graph, around each kick.

    Parameters
    ----------
    kappa : sequence of N floats, the kicks.
    n_kicks : int, 1 to 10⁶, the most kicks in either direction.
    sites : ints, the kicks around which to look; default those of the largest |κ| among neighbours.

    Returns
    -------
    ndarray of float64, shape (N,): K_c; no curve is a graph before all of c - K_c, …, c + K_c. inf
    where starts survive on all transversals that were tried, n_kicks or to an end of the sequence,
    and at kicks that are no sites.

    ValueError if kappa is no such vector, or a count or a site out of range.
    """
    strengths = forcing(kappa)
    n_kicks = count("n_kicks", n_kicks, 1, transversals.MAX_STEPS)
    sizes = np.pad(np.abs(strengths), 1)
    if sites is None:
        sites = np.flatnonzero((sizes[1:-1] >= sizes[:-2]) & (sizes[1:-1] >= sizes[2:]))
    times = np.full(strengths.size, inf)
    for site in sites:
        site = count("site", site, 0, strengths.size - 1)
        reach = min(n_kicks, site, strengths.size - 1 - site)
        around = strengths[site - reach : site + reach + 1]
        for a, bend in product((0.5, 0.0), _BENDS):
            if reach > 0:
                line = Transversal(reach, a, (bend,))
                times[site] = min(times[site], transversals.longest_lived(around, line, reach)[1])
                reach = int(min(reach, times[site]))
    return times


def longest_life(times):
    """For how many kicks, and from which one on, a curve may stay a graph at most.

    times : ndarray (N,), K_c by `elimination_times`. A curve that is a graph before kick b is none
    before all kicks up to min {c + K_c : c - K_c ≥ b}; what it is after kick N is not known.

    Returns
    -------
    kicks : float, maximised over b; N if nothing was eliminated. begin : int, that b.
    """
    ends = np.full(times.size, float(times.size))
    for site in np.flatnonzero(np.isfinite(times)):
        first = int(site - times[site])
        ends[first] = min(ends[first], site + times[site])
    lives = np.minimum.accumulate(ends[::-1])[::-1] - np.arange(times.size)
    begin = int(lives.argmax())
    return float(lives[begin]), begin
