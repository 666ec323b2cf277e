"""Study of stability: rounding in direct iteration, by the arithmetic it uses.

What it finds is said in `workflows.stability.findings`.
"""

import math

import numpy as np
from numba import njit

from nasm import circles
from nasm.arithmetic.sine import SINE, sin2pi
from nasm.numbers import parse
from workflows.shared.tables import dataset, listed


def rounding(quick):
    """9. Measure the drift off a circle of (0.3, 0.3), and the error of n steps and n back.

    lift: the polynomial sine, x not reduced. turns: the same, x reduced each kick. libm: math.sin
    of 2πx, reduced. lattice: y rounded to 2⁻⁵¹ each kick. float32: the polynomial, reduced.
    """
    kappa = np.array([0.3, 0.3])
    steps = 10 ** np.arange(2, 6 if quick else 8)
    circle = circles.invariant_circle(parse("gamma"), kappa, n_max=1024)
    x, y = (values[:: circle.u.shape[-1] // 8] for values in circles.graph(circle))
    x, y = (x + 3.0) - 3.0, (y + 3.0) - 3.0  # on the lattice of 2⁻⁵¹
    kernels = _arithmetics()
    drift, back = np.full((2, len(kernels), steps.size), np.nan)
    for i, (advance, retreat, kind) in enumerate(kernels.values()):
        at, done = (x.astype(kind), y.astype(kind)), 0
        start = at[0].copy(), at[1].copy()
        for j, n in enumerate(steps):
            advance(kappa.astype(kind), *at, n - done)
            done = n
            drift[i, j] = np.sqrt(np.mean(_height_above(circle, *at) ** 2))
            if n <= 10**6:
                there = at[0].copy(), at[1].copy()
                retreat(kappa.astype(kind), *there, n)
                off = [a.astype(float) - b for a, b in zip(there, start, strict=True)]
                back[i, j] = max(np.abs(off[0] - np.rint(off[0])).max(), np.abs(off[1]).max())
    dims = "arithmetic", "steps"
    return dataset(
        "Rounding",
        {"arithmetic": listed("arithmetic", *kernels), "steps": (steps, "steps of two kicks")},
        {
            "drift": (dims, drift, "rms distance in y from the circle, of 8 orbits"),
            "reversal": (dims, back, "largest error of x or y after n steps and back"),
        },
    )


def _height_above(circle, x, y):
    """Return y less that of the circle at the same x, by Newton's method for θ."""
    n = circle.u.shape[-1]
    modes = np.fft.rfft(np.stack([circle.u[0], circles.graph(circle)[1]])) / n
    modes[:, 1:] *= 2
    k = np.arange(modes.shape[1])
    x, y = x.astype(float), y.astype(float)
    x = x - np.floor(x)
    theta = x.copy()
    for _ in range(20):
        waves = np.exp(2j * np.pi * k * theta[:, None])
        u, slope = (waves @ modes[0]).real, 1 + (waves @ (2j * np.pi * k * modes[0])).real
        theta -= (theta + u - x) / slope
    return y - (np.exp(2j * np.pi * k * theta[:, None]) @ modes[1]).real


def _arithmetics():
    """Return {name: (advance, retreat, dtype)}, which iterate n steps forth or back, in place."""
    two_pi, two_pi_32 = 2 * np.pi, np.float32(2 * np.pi)
    c = tuple(np.float32(a) for a in SINE[5::-1])

    polynomial = njit(lambda kappa, x: kappa / two_pi * sin2pi(x))
    libm = njit(lambda kappa, x: kappa / two_pi * math.sin(two_pi * x))
    quantised = njit(lambda kappa, x: ((kappa / two_pi * sin2pi(x)) + 3.0) - 3.0)
    same, reduced = njit(lambda x: x), njit(lambda x: x - np.floor(x))

    @njit
    def single(kappa, x):
        a = abs(x - np.rint(x))
        u = np.float32(math.copysign(min(a, np.float32(0.5) - a), x - np.rint(x)))
        s = np.float32(0)
        for coefficient in c:
            s = coefficient + u * u * s
        return kappa / two_pi_32 * (two_pi_32 * u * s)

    def pair(force, wrap):
        @njit
        def advance(kappa, x, y, n):
            for i in range(x.size):
                a, b = x[i], y[i]
                for _ in range(n):
                    for strength in kappa:
                        b = b + force(strength, a)
                        a = wrap(a + b)
                x[i], y[i] = a, b

        @njit
        def retreat(kappa, x, y, n):
            for i in range(x.size):
                a, b = x[i], y[i]
                for _ in range(n):
                    for strength in kappa[::-1]:
                        a = wrap(a - b)
                        b = b - force(strength, a)
                x[i], y[i] = a, b

        return advance, retreat

    return {
        "lift": (*pair(polynomial, same), np.float64),
        "turns": (*pair(polynomial, reduced), np.float64),
        "libm": (*pair(libm, reduced), np.float64),
        "lattice": (*pair(quantised, reduced), np.float64),
        "float32": (*pair(single, reduced), np.float32),
    }
