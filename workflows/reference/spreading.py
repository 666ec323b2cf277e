"""Reference methods for diffusion rates and escape times, independent of the methods in `nasm`.

The Green-Kubo formula derives D from the correlations of the changes d_t = y_{t+1} - y_t, averaged
over the unit cell with uniform density,

    D = <d_0²>/2 + Σ_{τ=1}^L w_τ <d_0 d_τ>,    w_τ = (1 + cos πτ/L)/2.

The weights decrease smoothly, because correlations in islands do not decay; with a sharp cutoff, D
for the forcing (3, 2) would be up to 24% too large. `nasm.diffusion` computes D from the mean
squares of long displacements.

Escape times are computed from the transport of a density. The window is divided into cells; entry
(i, j) of Ulam's matrix is the fraction of cell j that T maps into cell i. If the matrix is applied
n times to the density of the starts, the total of the result is the fraction of orbits still inside
after n steps. The sum of these fractions over n is the mean escape time. Once the density has
reached its final shape, each step multiplies the fraction by a constant factor, the leading
eigenvalue of the matrix. `nasm.escape` follows orbits instead.
"""

import numpy as np
from scipy.sparse import coo_array

from nasm.maps import kick
from nasm.orbits import orbit


def green_kubo(kappa, n_starts, n_steps, n_lags):
    """Return D from correlations over up to n_lags steps, and its error.

    The error is three standard errors of the mean over starts, plus the change in D when the number
    of lags is halved.
    n_starts : a multiple of 256.
    """
    lags = np.arange(n_lags + 1)
    weights = np.stack(
        [(1 + np.cos(np.pi * np.minimum(lags / n, 1))) / 2 for n in (n_lags // 2, n_lags)]
    )
    weights[:, 0] /= 2
    random, sums = np.random.default_rng(59), []
    for _ in range(n_starts // 256):
        x, y = random.uniform(size=(2, 256))
        changes = np.diff(orbit(kappa, x, y, n_steps)[1], axis=0)
        power = np.abs(np.fft.rfft(changes, 2 * n_steps, axis=0)) ** 2
        correlations = np.fft.irfft(power, axis=0)[: n_lags + 1] / (n_steps - lags)[:, None]
        sums.append(weights @ correlations)
    half, all_lags = np.concatenate(sums, axis=1)
    scatter = all_lags.std(ddof=1) / all_lags.size**0.5
    return float(all_lags.mean()), float(3 * scatter + abs(all_lags.mean() - half.mean()))


def escapes(kappa, window, height, cells_per_turn):
    """Return the mean escape time and the survival factor per step, from Ulam's matrix.

    The starts fill 0 ≤ y ≤ height uniformly.
    """
    lower, upper = window
    n_x, n_y = cells_per_turn, round((upper - lower) * cells_per_turn)
    samples = (np.arange(16) + 0.5) / 16  # sample points along each side of a cell
    rows, columns = [], []
    for j in range(n_y):  # one row of cells at a time
        x = ((np.arange(n_x)[:, None] + samples) / n_x).ravel()
        x, y = np.meshgrid(x, lower + (j + samples) / n_y * (upper - lower))
        start = np.floor(x * n_x).astype(int) + j * n_x
        for strength in kappa:
            x, y = kick(strength, x, y)
        row = np.floor((y - lower) / (upper - lower) * n_y).astype(int)
        column = np.minimum(np.floor((x - np.floor(x)) * n_x).astype(int), n_x - 1)
        inside = (row >= 0) & (row < n_y)
        columns.append(start[inside])
        rows.append((row * n_x + column)[inside])
    rows, columns = np.concatenate(rows), np.concatenate(columns)
    shares = np.full(rows.size, samples.size**-2.0)
    moved = coo_array((shares, (rows, columns)), shape=(n_x * n_y,) * 2).tocsr()
    edges = lower + np.arange(n_y + 1) / n_y * (upper - lower)
    filled = np.clip(np.minimum(edges[1:], height) - np.maximum(edges[:-1], 0), 0, None)
    density = np.repeat(filled / filled.sum() / n_x, n_x)
    inside, total = 1.0, 0.0
    while inside > 1e-12:
        total += inside
        density = moved @ density
        factor, inside = density.sum() / inside, density.sum()
    return float(total), float(factor)
