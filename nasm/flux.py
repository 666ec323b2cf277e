"""The flux through a broken circle: the difference in action of two periodic orbits.

A broken circle leaves behind a cantorus, and orbits pass through its gaps. In one step of T the
same area passes upwards and downwards,

    ΔW = lim ΔW_{p/q},    ΔW_{p/q} = W(minimax orbit) - W(minimizing orbit),

where the limit is taken over the convergents p/q of ω (MacKay, Meiss & Percival, Physica D 13
(1984) 55), and W is the action

    W = Σ_n (x_{n+1} - x_n)²/2 - (κ_n/4π²) cos 2πx_n

summed over the Pq sites of a periodic orbit. While the circle exists, ΔW_{p/q} tends to 0 faster
than any power of 1/q; beyond its breakup it has a positive limit, which grows like (κ - κ_c)^3.01
for noble ω (the exponent is MacKay's ln(αβ)/ln δ). The two actions share most of their digits, so
they are not subtracted from each other. Instead, let d_n be the distance from a site of the
minimizing orbit to the next site of the minimax orbit. Since the minimizing orbit is stationary,

    ΔW_{p/q} = Σ (d_{n+1} - d_n)²/2 + (κ_n/4π²) [2 cos 2πx_n sin² πd_n
                                                  + sin 2πx_n (sin 2πd_n - 2πd_n)].

This is the flux through the widest gap of the minimizing orbit. Far beyond the breakup, or close
to a forcing of shorter period, a cantorus may also have other gaps, with a larger flux.
"""

from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import ArrayLike

from nasm.action import FLAT, MAX_PERIOD, ConvergentOrbits, LostError, Orbit, ordered_orbits
from nasm.arithmetic.sine import cos2pi, sin2pi
from nasm.checks import count
from nasm.maps import TWO_PI, forcing
from nasm.numbers import (
    RotationNumber,
    as_rotation_number,
    convergents,
    distinct_convergents,
)
from nasm.results import Result, Status
from nasm.symmetries import shorten
from nasm.tables import html_table, status_text
from nasm.texts import rounded_value
from nasm.types import OmegaLike

__all__ = ["Flux", "FluxSettings", "action_difference", "flux"]


@dataclass(frozen=True)
class FluxSettings:
    """Limits on the relative change of ΔW from one convergent to the next.

    Attributes
    ----------
    target_change : float
        The search ends once the change is no larger than this.
    max_change : float
        Largest change that is accepted if the search cannot be continued.

    Examples
    --------
    >>> from nasm.flux import FluxSettings, flux
    >>> rough = flux("gamma", (1.1,), settings=FluxSettings(target_change=1e-3))
    >>> rough.period < flux("gamma", (1.1,)).period
    True
    """

    target_change: float = 1e-6
    max_change: float = 0.01


DEFAULT_SETTINGS = FluxSettings()


@dataclass(frozen=True, eq=False, repr=False)
class Flux(Result):
    """Flux through the cantorus of ω, per step of T (one period of the forcing).

    It prints on one line, with the digits that the error justifies; notebooks show it as a table.

    Attributes
    ----------
    value : float
        Area, in turns times y; it is 0 to within `error` while the circle exists, and NaN if status
        is not OK.
    error : float
        Estimated absolute error.
    period : int
        Longest period of the orbits used.
    omega : RotationNumber
        Rotation number of the cantorus per step.
    status : Status
        OK, or the reason and a remedy.

    Examples
    --------
    >>> from nasm.flux import flux
    >>> flux("gamma", (1.1,))
    Flux(3.726...e-05 ± ... per step, orbits of period ..., circle [0;(1)], OK)
    """

    value: float
    error: float
    period: int
    omega: RotationNumber
    status: Status

    def __repr__(self) -> str:
        orbits = f"orbits of period {self.period}"
        return f"Flux({self._value()}, {orbits}, circle {self.omega}, {status_text(self.status)})"

    def _repr_html_(self) -> str:
        """Return the table that a notebook shows."""
        rows = {
            "flux": self._value(),
            "rotation number": f"{self.omega} = {float(self.omega):.12g} per step",
            "longest period used": f"{self.period}",
            "status": status_text(self.status),
        }
        return html_table(rows, "Flux through a cantorus")

    def _value(self) -> str:
        if np.isnan(self.value):
            return "no value"
        return f"{rounded_value(self.value, self.error)} per step"


def flux(
    omega: OmegaLike,
    kappa: ArrayLike,
    q_max: int = 30_000,
    settings: FluxSettings = DEFAULT_SETTINGS,
) -> Flux:
    """Compute ΔW for successive convergents of ω, until it converges or is lost in rounding errors.

    Parameters
    ----------
    omega : RotationNumber or str
        Irrational rotation number per step, e.g. "gamma".
    kappa : array_like, shape (P,)
        The forcing, first kick first.
    q_max : int
        Longest period used, up to 10⁶. A period of 30 000 suffices at a relative distance of 10⁻³
        or more beyond the breakup, and one of 200 000 at 10⁻⁴ or more.
    settings : FluxSettings
        Criteria for the convergence of ΔW.

    Returns
    -------
    Flux
        error: the last change, plus the rounding error of the sum; the last change bounds later
        ones, because they shrink faster than geometrically. status: OK; RATIONAL if ω is rational;
        NOT_CONVERGED close to the breakup, if orbits up to q_max do not show which side of it
        kappa is on; DISORDERED if longer orbits were not found and the change had not yet fallen
        below 1%.

    Raises
    ------
    ValueError
        If an argument is out of range.

    Examples
    --------
    >>> from nasm.flux import flux
    >>> beyond = flux("gamma", (1.1,))
    >>> print(f"{beyond.value:.3g}", beyond.status)
    3.73e-05 Status.OK
    """
    kappa, q_max = forcing(kappa), count("q_max", q_max, 1, MAX_PERIOD)
    omega = as_rotation_number(omega)
    (short,), short_omega = shorten([kappa], omega)
    if omega.is_rational:
        return Flux(np.nan, np.nan, 0, omega, Status.RATIONAL)
    steps = kappa.size // short.size
    # All numbers with this prefix share its convergents, so one more convergent is needed.
    min_period = list(islice(convergents(short_omega), len(short_omega.prefix) + 1))[-1].denominator
    orbits = ConvergentOrbits(short, 0 * short, distinct_convergents(short_omega, q_max))
    value, error, period, status = np.nan, np.inf, 0, Status.NOT_CONVERGED
    n_lost = 0
    for n, chain in enumerate(orbits.chains):
        try:
            difference, rounding = _difference(*(orbits.at(n, 0.0, kind) for kind in (1, -1)))
            n_lost = 0
        except LostError:
            difference, rounding, n_lost = np.nan, 0.0, n_lost + 1
            if n_lost == 1:  # longer orbits may be found again
                continue
        if not difference > -rounding:  # no orbits twice in a row, or actions in the wrong order
            status = Status.DISORDERED
            break
        value, error, period = difference, abs(difference - value) + rounding, chain.q
        if chain.q >= min_period and error <= max(settings.target_change * value, 2 * rounding):
            status = Status.OK
            break
    is_accepted = period >= min_period and error <= settings.max_change * value
    if status is Status.OK or is_accepted:
        return Flux(steps * value, steps * error, period, omega, Status.OK)
    return Flux(np.nan, np.nan, period, omega, status)


def action_difference(kappa: ArrayLike, p: int, q: int) -> float:
    """Compute ΔW_{p/q}, the area per step that passes through the gaps of the ordered p/q orbits.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        The forcing, first kick first.
    p, q : int
        Coprime integers, 1 ≤ q ≤ 10⁶.

    Returns
    -------
    float
        The area, in turns times y; NaN if either of the two orbits is not found.

    Examples
    --------
    >>> from nasm.flux import action_difference
    >>> print(f"{action_difference((0.5,), 0, 1):.8f}")
    0.02533030
    """
    try:
        return _difference(*ordered_orbits(kappa, p, q))[0]
    except LostError:
        return np.nan


def _difference(minimizing: Orbit, minimax: Orbit) -> tuple[float, float]:
    """Compute ΔW of two orbits and a bound on its rounding error."""
    u, kappa = minimizing.u, np.resize(minimizing.kappa, minimizing.u.size)
    if minimax.residue == 0:  # the reduced action is constant to within rounding
        return 0.0, FLAT * u.size**0.5 / minimizing.chain.q
    x, d = minimizing.chain.theta + u, minimax.u - u
    bend = 2 * cos2pi(x) * sin2pi(d / 2) ** 2 + sin2pi(x) * (sin2pi(d) - TWO_PI * d)
    terms = np.stack([(np.roll(d, -1) - d) ** 2 / 2, kappa / TWO_PI**2 * bend])
    # Add the errors of the sum and of the minimizing orbit, which is stationary to one ulp.
    rounding = np.finfo(float).eps * (np.abs(terms).sum() + np.linalg.norm(d))
    return float(terms.sum()), float(rounding)
