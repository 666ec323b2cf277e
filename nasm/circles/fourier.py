"""Periodic functions on a grid: rotations by ω, derivatives, small divisors.

    f(θ) = Σ_k f̂_k e^{2πikθ},     f(θ + ω) ↔ e^{2πikω} f̂_k,     f'(θ) ↔ 2πik f̂_k

A function is its values at θ = i/n, along the last axis. The equations of KAM theory,
g(θ + ω) - g(θ) = f(θ), divide f̂_k by e^{2πikω} - 1: small when k is the denominator of a convergent
of ω, and never zero only because ω is irrational. So the phases kω mod 1 are taken from integers.
"""

from functools import lru_cache
from math import ceil

import numpy as np

from nasm.maps import TWO_PI
from nasm.numbers import convergents, distinct_convergents

__all__ = ["derivative", "resample", "rotate", "solve_cohomology"]

_LARGEST_DENOMINATOR = 10**12  # k·p stays below 2⁶³ up to k = 9·10⁶


@lru_cache(maxsize=16)
def turns(omega, n_modes):
    """e^{2πikω} for k = 0, …, n_modes - 1, read-only; of a RotationNumber, to the last digits.

    kω mod 1 is exact for a convergent p/q of ω with q ≤ 10¹², which misses ω by less than 1/q².
    """
    p, q = distinct_convergents(omega, _LARGEST_DENOMINATOR)[-1].as_integer_ratio()
    k = np.arange(n_modes, dtype=np.int64) * (p % q) % q
    values = np.exp(1j * TWO_PI * (np.where(2 * k > q, k - q, k) / q))
    values.flags.writeable = False
    return values


_KEPT = 0.36  # of the n points: the modes that are kept, so that products do not alias much
_EVEN = 16  # that divides n: transforms of lengths like 3⁵·5⁵ take a fifth longer


def grid(omega, n_modes):
    """The number of points of a grid whose `cut` leaves n_modes or more, just below a resonance.

    Near a breakup the modes up to the next resonance are small, and those from it on are not.
    """
    from rocket_fft import good_size  # as SciPy's next_fast_len, which takes a while to import

    for fraction in convergents(omega):
        if fraction.denominator >= max(n_modes, 100):
            n = _EVEN * good_size(ceil((fraction.denominator + 1) / _KEPT / _EVEN), real=True)
            if cut(omega, n) >= n_modes:  # not so if another resonance is just below
                return n
    raise ValueError(f"omega={omega} is rational; a circle needs an irrational rotation number")


@lru_cache(maxsize=256)
def cut(omega, n):
    """Number of modes to keep on a grid of n points: 36% of n, or less.

    A cut just above a resonant mode, the denominator q of a convergent, would keep that mode and
    drop the ones that it drives: the cut is then moved below it.
    """
    kept = int(_KEPT * n)
    below = (fraction.denominator for fraction in distinct_convergents(omega, kept - 1))
    return next((q for q in below if q > 0.8 * kept), kept)


def rotate(f, turn):
    """f(θ + ω) with turn = `turns`(ω); f(θ - ω) with its conjugate."""
    n = f.shape[-1]
    return np.fft.irfft(np.fft.rfft(f) * turn[: n // 2 + 1], n)


def derivative(f):
    """f'(θ)."""
    n = f.shape[-1]
    return np.fft.irfft(np.fft.rfft(f) * (1j * TWO_PI * np.arange(n // 2 + 1)), n)


def solve_cohomology(f, turn, kept):
    """g with g(θ + ω) - g(θ) = f(θ) - ⟨f⟩ and ⟨g⟩ = 0, of fewer than `kept` modes."""
    n = f.shape[-1]
    modes = np.fft.rfft(f)
    modes[..., 0] = modes[..., kept:] = 0
    modes[..., 1:kept] /= turn[1:kept] - 1
    return np.fft.irfft(modes, n)


def resample(f, n):
    """The same function on a grid of n points; exact if it has fewer than n/2 modes."""
    modes = np.fft.rfft(f)
    return np.fft.irfft(modes[..., : n // 2 + 1] * (n / f.shape[-1]), n)
