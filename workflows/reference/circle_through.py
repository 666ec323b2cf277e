"""A second method for rotation numbers: find the circle that passes through a start.

The momentum Y(ω) at which the circle of ω crosses the line x = const increases with ω. So the
rotation number of a start (x, y) solves Y(ω) = y. Circles of noble ω, which are robust, are
computed by Newton's method in Fourier space. The secant method ends with two circles so close
that Y is linear between them up to rounding.
"""

import numpy as np

from nasm.circles import NewtonSettings, invariant_circle
from nasm.numbers import nobles_near
from nasm.orbits import orbit

FINE = NewtonSettings(max_tail=1e-6, max_update=1e-13)
"""Settings for circles accurate to rounding: errors of their momenta limit the secant method."""

_WIDTHS = 1e-2, 1e-3, 1e-5, 1e-8  # distances from the estimates within which nobles are sought


def momentum_on(circle, x):
    """Return y of a circle at x, modulo 1: x = θ + u_0(θ), y = ω/P + u_0(θ) - u_{P-1}(θ - ω)."""
    n_kicks, n = circle.u.shape
    modes = np.fft.rfft(circle.u) / n
    modes[:, 1:] *= 2
    waves = 2j * np.pi * np.arange(modes.shape[1])
    theta = x
    for _ in range(50):
        wave = np.exp(waves * theta)
        off = theta + (modes[0] @ wave).real - x
        step = off / (1 + (modes[0] @ (waves * wave)).real)
        theta -= step
        if abs(step) < 1e-15:
            break
    before = np.exp(waves * (theta - float(circle.omega)))
    deviations = (modes[0] @ np.exp(waves * theta)).real, (modes[-1] @ before).real
    return float(circle.omega) / n_kicks + deviations[0] - deviations[1]


def rotation_number(kappa, x, y):
    """Return ω of the circle through (x, y), and the last change of the estimate.

    Both are NaN if a circle needed for the estimate is not certified.
    """
    xs, _ = orbit(kappa, x, y, 1000)
    estimate, known = (xs[-1] - xs[0]) / 1000, {}
    for width in _WIDTHS:
        nobles = nobles_near(float(estimate), width, 30)
        omega = next((noble for noble in nobles if noble not in known), None)
        circle = None if omega is None else invariant_circle(omega, kappa, settings=FINE)
        if circle is None or not circle.certified:
            return np.nan, np.nan
        known[omega] = momentum_on(circle, x) - y
        if len(known) > 1:
            (one, before), (other, after) = list(known.items())[-2:]
            slope = (after - before) / (float(other) - float(one))
            last, estimate = estimate, float(other) - after / slope
    return estimate, max(abs(estimate - last), 4 * np.finfo(float).eps)
