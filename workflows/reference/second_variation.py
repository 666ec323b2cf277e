"""Second method for ramps: find when the second variation eliminates the last start on a line.

For a start just before the kick at a site, the second variation of the action at the sites |k| < n
of its orbit is the tridiagonal matrix with

    a_k = 2 + κ_k cos 2πx_k on the diagonal,    and -1 next to the diagonal.

If it is not positive definite, no graph that persists for n kicks before and after the site passes
through the start. `nasm.converse_kam.aperiodic` tests this with a tangent vector that starts at the
site. Here Gaussian elimination proceeds from both ends of the matrix to the middle,

    d_k = a_k - 1/d_{k+1},    d_{-k} = a_{-k} - 1/d_{-k-1},    a_0 - 1/d_1 - 1/d_{-1} > 0,

separately for each n. The starts form a dense grid, whose best cells are refined; `nasm` uses
a beam search on two coarser grids.
"""

import numpy as np

_CHILDREN = 32  # number of new starts in each of the best cells


def lifetimes(kappa, site, x, y):
    """Return, for each y, the smallest n at which the second variation is not positive definite."""
    times, alive = np.full(y.size, np.inf), np.arange(y.size)
    ahead, p, behind, q = np.full(y.size, x), y.copy(), np.full(y.size, x), y.copy()
    later, earlier = [], []  # a_1, a_2, … and a_{-1}, a_{-2}, …
    middle = 2 + kappa[site] * np.cos(2 * np.pi * ahead)
    for n in range(1, min(site, kappa.size - 1 - site) + 1):
        positive = _is_positive(middle, later, earlier)
        times[alive[~positive]] = n
        alive, middle = alive[positive], middle[positive]
        later, earlier = ([a[positive] for a in side] for side in (later, earlier))
        ahead, p, behind, q = (z[positive] for z in (ahead, p, behind, q))
        if not alive.size:
            break
        p = p + kappa[site + n - 1] / (2 * np.pi) * np.sin(2 * np.pi * ahead)
        ahead = ahead + p
        later.append(2 + kappa[site + n] * np.cos(2 * np.pi * ahead))
        behind = behind - q
        q = q - kappa[site - n] / (2 * np.pi) * np.sin(2 * np.pi * behind)
        earlier.append(2 + kappa[site - n] * np.cos(2 * np.pi * behind))
    return times


def _is_positive(middle, later, earlier):
    positive = np.ones(middle.size, bool)
    for side in (later, earlier):
        d = np.full(middle.size, np.inf)
        for a in reversed(side):
            d = a - 1 / np.where(positive, d, np.inf)
            positive &= d > 0
        middle = middle - 1 / np.where(positive, d, np.inf)
    return positive & (middle > 0)


def longest_lifetime(kappa, site, n_starts, n_best):
    """Return the longest lifetime of starts on x = 1/2, 0 ≤ y ≤ 1, just before the kick at site."""
    width = 1 / n_starts
    centres = (np.arange(n_starts) + 0.5) * width
    longest = 0.0
    while width > np.finfo(float).eps:
        times = lifetimes(kappa, site, 0.5, centres)
        longest = max(longest, times.max())
        best = centres[np.argsort(-times, kind="stable")[:n_best]]
        width /= _CHILDREN
        offsets = (np.arange(_CHILDREN) + 0.5 - _CHILDREN / 2) * width
        centres = (best[:, None] + offsets).ravel()
    return longest
