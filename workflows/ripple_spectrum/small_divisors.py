"""Small divisors: when a ripple destroys a circle under constant kicks, to first order in depth.

    x_n = h(θ_n + d·Re[w(θ_n) e^{2πinΩ}]) + O(d²),     θ_n = θ + nω

are orbits under κ(1 + d cos 2πnΩ), where h(θ) = θ + u(θ) is a circle under constant kicks κ. As
in `nasm.circles.newton`, the linearised equation, multiplied by h', telescopes. With
f⁺ = e^{2πiΩ} f(θ + ω) and f⁻ = e^{-2πiΩ} f(θ - ω),

    c (w⁺ - w) - [c (w⁺ - w)]⁻ = h'(θ) (κ/2π) sin 2πh(θ),     c(θ) = h'(θ) h'(θ + ω).

Solving this equation divides the mode e^{2πimθ} twice by e^{2πi(mω + Ω)} - 1: w resonates where Ω
is near -mω mod 1. To this order the curve is a graph before every kick, whatever the phase of the
ripple, as long as d·max |w'| < 1. The predicted threshold of a circle is the strength κ at which
this condition fails. The threshold of the forcing is the largest threshold among several nobles,
because where a resonance breaks one circle early, another circle persists longer.

The prediction has no free parameter. It neglects the sidebands mω + kΩ, |k| > 1. A slow ripple
excites these sidebands by sweeping the rotation number over many resonances.
"""

from functools import cache
from itertools import product

import numpy as np

from nasm import circles, periodic
from nasm.circles import fourier
from nasm.numbers import RotationNumber
from nasm.results import Status

# Number of partial quotients that may exceed those of [0;2,(1)], and their total excess.
_PLACES, _EXCESS = 5, 2
_RELATIVE_SCALES = (0.2, 0.4, 0.55, 0.7, 0.8, 0.87, 0.92, 0.96, 0.98)  # relative to the breakup


def nobles():
    """List nobles in [0, 1/2] whose partial quotients hardly exceed those of [0;2,(1)].

    The excesses add up to at most 2.
    """
    steps = [row for row in product(range(_EXCESS + 1), repeat=_PLACES) if sum(row) <= _EXCESS]
    return [RotationNumber((0, 2 + first, *(1 + a for a in rest)), (1,)) for first, *rest in steps]


def strain(u, omega, kappa, frequencies):
    """Compute max |w'| for each frequency Ω.

    Parameters
    ----------
    u : ndarray, shape (n,)
        The deviation u(θ) = h(θ) - θ of the circle.
    omega : float
        Rotation number of the circle.
    kappa : float
        Strength of the constant kicks.
    frequencies : ndarray
        Ω, turns per kick.
    """
    n = u.size
    theta, modes = np.arange(n) / n, np.fft.fftfreq(n, 1 / n)
    slope = 1 + fourier.derivative(u)
    after = 1 + np.fft.ifft(np.fft.fft(slope - 1) * np.exp(2j * np.pi * modes * omega)).real
    kick = np.fft.fft(slope * kappa / (2 * np.pi) * np.sin(2 * np.pi * (theta + u)))
    kept = np.abs(modes) < n / 3
    largest = []
    for frequency in frequencies:
        turn = np.exp(2j * np.pi * (modes * omega + frequency))
        flux = np.fft.ifft(np.where(kept, kick / (1 - turn.conj()), 0))
        w = np.where(kept, np.fft.fft(flux / (slope * after)) / (turn - 1), 0)
        largest.append(np.abs(np.fft.ifft(2j * np.pi * modes * w)).max())
    return np.array(largest)


@cache
def family(omega):
    """Return κ_c of a circle under constant kicks, and a list of its certified (κ, u) below κ_c."""
    breakup, u, members = periodic.critical_scale(omega, (1.0,), 1500), None, []
    if breakup.status is not Status.OK:
        return np.nan, []
    for kappa in breakup.value * np.array(_RELATIVE_SCALES):
        circle = circles.invariant_circle(omega, kappa, start=u)
        if not circle.certified:
            break
        u = circle.u
        members.append((float(kappa), u[0]))
    return breakup.value, members


def thresholds(omega, frequencies, depths):
    """Predict the κ at which a circle breaks because d·max |w'| reaches 1, as an array over (Ω, d).

    1/max |w'| is interpolated in κ; it vanishes at the breakup under constant kicks, and is
    proportional to 1/κ for weak kicks.
    """
    last, members = family(omega)
    if not members:
        return np.full((len(frequencies), len(depths)), np.nan)
    kappas = np.array([kappa for kappa, _ in members] + [last])
    strains = [strain(u, float(omega), kappa, frequencies) for kappa, u in members]
    inverse = np.minimum.accumulate([*(1 / np.array(strains)), np.zeros(len(frequencies))])
    weak = kappas[0] * inverse[0][:, None] / depths
    return np.minimum(weak, [np.interp(depths, row[::-1], kappas[::-1]) for row in inverse.T])


def predicted(frequencies, depths):
    """Predict the threshold under each ripple: κ and ω of the noble that breaks last.

    Returns
    -------
    kappa, omega : ndarray, shape (frequencies, depths)
    """
    frequencies, depths = np.asarray(frequencies), np.asarray(depths)
    names = nobles()
    scales = np.array([thresholds(omega, frequencies, depths) for omega in names])
    last = np.nanargmax(scales, axis=0)
    return np.nanmax(scales, axis=0), np.array(list(map(float, names)))[last]
