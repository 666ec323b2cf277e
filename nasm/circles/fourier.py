"""Periodic functions on a grid: rotations by ω, derivatives, small divisors.

    f(θ) = Σ_k f̂_k e^{2πikθ},     f(θ + ω) ↔ e^{2πikω} f̂_k,     f'(θ) ↔ 2πik f̂_k

A function is represented by the array of its values at θ = i/n, along the last axis. To solve an
equation of KAM theory, g(θ + ω) - g(θ) = f(θ), each f̂_k is divided by e^{2πikω} - 1. This divisor
is small if k is the denominator of a convergent of ω; for k ≠ 0 it is nonzero only because ω is
irrational. The phases kω mod 1 are therefore computed in integer arithmetic.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import ceil

import numpy as np
from numpy.typing import NDArray

from nasm.maps import TWO_PI
from nasm.numbers import convergents, distinct_convergents, irrational
from nasm.types import FloatArray, OmegaLike

__all__ = ["GridSettings", "derivative", "resample", "rotate", "solve_cohomology"]


@dataclass(frozen=True)
class GridSettings:
    """Settings for the number of points of a grid, and for the number of modes kept on it.

    Attributes
    ----------
    mode_ratio : float
        Ratio of the number of modes kept to the number of points. It is small enough that products
        cause little aliasing.
    resonance_ratio : float
        The cut (the number of modes kept) is moved below a resonant mode whose number exceeds this
        fraction of the cut.
    min_modes : int
        Every grid that `grid` chooses is fine enough for this number of modes.
    size_factor : int
        Common factor of all sizes that `grid` chooses; it avoids lengths like 3⁵·5⁵, whose
        transforms take a fifth longer.

    Examples
    --------
    >>> from nasm.circles.fourier import GridSettings, cut
    >>> cut("gamma", 256), cut("gamma", 256, GridSettings(mode_ratio=0.3))
    (89, 76)
    """

    mode_ratio: float = 0.36
    resonance_ratio: float = 0.8
    min_modes: int = 100
    size_factor: int = 16


DEFAULT_GRID_SETTINGS = GridSettings()


@lru_cache(maxsize=16)
def turns(omega: OmegaLike, n_modes: int) -> NDArray[np.complex128]:
    """Compute e^{2πikω} for k = 0, …, n_modes - 1, to within rounding.

    The phase kω mod 1 is computed exactly, with ω replaced by a convergent p/q with q ≤ 10¹², which
    differs from ω by less than 1/q².

    Returns
    -------
    ndarray, shape (n_modes,), complex
        Read-only.

    Examples
    --------
    >>> from nasm.circles.fourier import turns
    >>> turns("gamma", 2).round(3)
    array([ 1.   +0.j   , -0.737-0.675j])
    """
    max_q = 10**12  # k·p stays below 2⁶³ up to k = 9·10⁶, more than half of the points of any grid
    p, q = distinct_convergents(omega, max_q)[-1].as_integer_ratio()
    k = np.arange(n_modes, dtype=np.int64) * (p % q) % q
    values = np.exp(1j * TWO_PI * (np.where(2 * k > q, k - q, k) / q))
    values.flags.writeable = False
    return values


def grid(omega: OmegaLike, n_modes: float, settings: GridSettings = DEFAULT_GRID_SETTINGS) -> int:
    """Choose a grid size for which `cut` keeps n_modes or more, ending just below a resonance.

    Near a breakup, the modes just below a resonance are small, but those beyond it are not.

    Raises
    ------
    ValueError
        If omega is rational.

    Examples
    --------
    >>> from nasm.circles.fourier import cut, grid
    >>> n = grid("gamma", 200)
    >>> cut("gamma", n)
    233
    """
    from rocket_fft import good_size  # like SciPy's next_fast_len, which takes a while to import

    factor = settings.size_factor
    for fraction in convergents(irrational(omega)):
        if fraction.denominator >= max(n_modes, settings.min_modes):
            n_points = (fraction.denominator + 1) / settings.mode_ratio
            n = factor * good_size(ceil(n_points / factor), real=True)
            if cut(omega, n, settings) >= n_modes:  # false if another resonance is just below
                return n
    raise AssertionError("the convergents of an irrational number are endless")


@lru_cache(maxsize=256)
def cut(omega: OmegaLike, n: int, settings: GridSettings = DEFAULT_GRID_SETTINGS) -> int:
    """Choose the number of modes to keep on a grid of n points: 36% of n, or fewer.

    A mode is resonant if its number is the denominator q of a convergent. A cut just above such a
    mode would keep it but drop the modes that it drives, so the cut is moved below the
    resonant mode.

    Examples
    --------
    >>> from nasm.circles.fourier import cut
    >>> cut("gamma", 256)
    89
    """
    kept = int(settings.mode_ratio * n)
    below = (fraction.denominator for fraction in distinct_convergents(omega, kept - 1))
    return next((q for q in below if q > settings.resonance_ratio * kept), kept)


def rotate(f: FloatArray, turn: NDArray[np.complex128]) -> FloatArray:
    """Compute f(θ + ω) with the factors from `turns`, or f(θ - ω) with their conjugates.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.circles.fourier import rotate, turns
    >>> rotate(np.array([0.0, 1.0, 0.0, -1.0]), turns("1/4", 3)).round(12) + 0.0
    array([ 1.,  0., -1.,  0.])
    """
    n = f.shape[-1]
    return np.fft.irfft(np.fft.rfft(f) * turn[: n // 2 + 1], n)


def derivative(f: FloatArray) -> FloatArray:
    """Compute f'(θ).

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.circles.fourier import derivative
    >>> theta = np.arange(8) / 8
    >>> (derivative(np.sin(2 * np.pi * theta)) / (2 * np.pi)).round(3)[:3]
    array([1.   , 0.707, 0.   ])
    """
    n = f.shape[-1]
    return np.fft.irfft(np.fft.rfft(f) * (1j * TWO_PI * np.arange(n // 2 + 1)), n)


def solve_cohomology(f: FloatArray, turn: NDArray[np.complex128], kept: int) -> FloatArray:
    """Solve g(θ + ω) - g(θ) = f(θ) - ⟨f⟩ with ⟨g⟩ = 0, using only the modes below `kept`.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.circles.fourier import rotate, solve_cohomology, turns
    >>> f, turn = np.cos(2 * np.pi * np.arange(16) / 16), turns("gamma", 9)
    >>> g = solve_cohomology(f, turn, 5)
    >>> bool(np.allclose(rotate(g, turn) - g, f))
    True
    """
    n = f.shape[-1]
    modes = np.fft.rfft(f)
    modes[..., 0] = modes[..., kept:] = 0
    modes[..., 1:kept] /= turn[1:kept] - 1
    return np.fft.irfft(modes, n)


def resample(f: FloatArray, n: int) -> FloatArray:
    """Interpolate f on a grid of n points; exact if f has fewer than n/2 modes.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.circles.fourier import resample
    >>> resample(np.array([0.0, 1.0, 0.0, -1.0]), 8)[:3].round(3) + 0.0
    array([0.   , 0.707, 1.   ])
    """
    modes = np.fft.rfft(f)
    return np.fft.irfft(modes[..., : n // 2 + 1] * (n / f.shape[-1]), n)
