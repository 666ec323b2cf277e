"""The flux through a broken circle: the difference in action of two periodic orbits.

Where the circle of ω is broken a cantorus is left, and orbits pass through its gaps. The area that
passes upwards in one step of T, and as much downwards, is

    ΔW = lim ΔW_{p/q},    ΔW_{p/q} = W(minimax orbit) - W(minimizing orbit),

over the convergents p/q of ω (MacKay, Meiss & Percival, Physica D 13 (1984) 55), with the action

    W = Σ_n (x_{n+1} - x_n)²/2 - (κ_n/4π²) cos 2πx_n

over the Pq sites of a period. While the circle exists ΔW_{p/q} tends to 0 faster than any power of
1/q; beyond its breakup it has a limit, which grows like (κ - κ_c)^3.01 for noble ω (MacKay's
ln(αβ)/ln δ). The two actions share most of their digits. With d_n the distance of the minimax
orbit's sites from the minimizing orbit's next to them, and since that one is stationary,

    ΔW_{p/q} = Σ (d_{n+1} - d_n)²/2 + (κ_n/4π²) [2 cos 2πx_n sin² πd_n
                                                  + sin 2πx_n (sin 2πd_n - 2πd_n)].

It is the flux through the widest gap of the minimizing orbit. Far beyond the breakup, or next to a
forcing of a shorter period, a cantorus may have other gaps too, which let more pass.
"""

from dataclasses import dataclass
from itertools import islice

import numpy as np

from nasm.action import FLAT, MAX_PERIOD, Ladder, LostError, ordered_orbits
from nasm.arithmetic.sine import cos2pi, sin2pi
from nasm.checks import count
from nasm.critical import Status
from nasm.maps import TWO_PI, forcing
from nasm.numbers import (
    RotationNumber,
    as_rotation_number,
    convergents,
    distinct_convergents,
)
from nasm.symmetries import shorten

__all__ = ["Flux", "action_difference", "flux"]

_AIM, _SETTLED = 1e-6, 0.01  # change from one convergent to the next: wanted, and accepted


@dataclass(frozen=True)
class Flux:
    """The flux through the remains of the circle of ω, per step of T.

    value : area, in turns times y; 0 to within `error` while the circle exists, NaN if status is
        not OK.
    error : estimated absolute error.
    period : the longest period of the orbits used.
    """

    value: float
    error: float
    period: int
    omega: RotationNumber
    status: Status


def flux(omega, kappa, q_max=30_000):
    """ΔW of the convergents of ω, until it changes no more or is lost in rounding.

    omega : RotationNumber or its text, irrational; e.g. "gamma".
    kappa : sequence of P floats, the forcing, first kick first.
    q_max : int up to 10⁶, the longest period used. 30 000 do from 10⁻³ beyond the breakup on,
        200 000 from 10⁻⁴.

    Returns Flux. error : the last change and the rounding of the sum; the changes shrink faster
    than geometrically. Status NOT_CONVERGED next to the breakup, where orbits up to q_max do not
    tell on which side of it kappa is, DISORDERED where longer orbits were lost before changes fell
    below 1%.
    """
    kappa, q_max = forcing(kappa), count("q_max", q_max, 1, MAX_PERIOD)
    omega = as_rotation_number(omega)
    (short,), short_omega = shorten([kappa], omega)
    if omega.is_rational:
        return Flux(np.nan, np.nan, 0, omega, Status.RATIONAL)
    steps = kappa.size // short.size
    # Up to the end of the prefix these are convergents of other numbers too.
    enough = list(islice(convergents(short_omega), len(short_omega.prefix) + 1))[-1].denominator
    ladder = Ladder(short, 0 * short, distinct_convergents(short_omega, q_max))
    value, error, period, status = np.nan, np.inf, 0, Status.NOT_CONVERGED
    lost = 0
    for n, chain in enumerate(ladder.chains):
        try:
            longer, rounding = _difference(*(ladder.at(n, 0.0, kind) for kind in (1, -1)))
            lost = 0
        except LostError:
            longer, rounding, lost = np.nan, 0.0, lost + 1
            if lost == 1:  # longer ones may be found again
                continue
        if not longer > -rounding:  # orbits are lost, or nearer to each other than rounding
            status = Status.DISORDERED
            break
        value, error, period = longer, abs(longer - value) + rounding, chain.q
        if chain.q >= enough and error <= max(_AIM * value, 2 * rounding):
            status = Status.OK
            break
    if status is Status.OK or (period >= enough and error <= _SETTLED * value):
        return Flux(steps * value, steps * error, period, omega, Status.OK)
    return Flux(np.nan, np.nan, period, omega, status)


def action_difference(kappa, p, q):
    """ΔW_{p/q}, the area that passes through the gaps of the ordered p/q orbits in one step.

    kappa : sequence of P floats, the forcing, first kick first.
    p, q : ints without common factor, 1 ≤ q ≤ 10⁶.

    Returns float; NaN if one of the two orbits is not found.
    """
    try:
        return _difference(*ordered_orbits(kappa, p, q))[0]
    except LostError:
        return np.nan


def _difference(minimizing, minimax):
    """ΔW of two orbits, and how far rounding may have moved it."""
    u, kappa = minimizing.u, np.resize(minimizing.kappa, minimizing.u.size)
    if minimax.residue == 0:  # and the slope of the reduced action nowhere more than rounding
        return 0.0, FLAT * u.size**0.5 / minimizing.chain.q
    x, d = minimizing.chain.theta + u, minimax.u - u
    bend = 2 * cos2pi(x) * sin2pi(d / 2) ** 2 + sin2pi(x) * (sin2pi(d) - TWO_PI * d)
    terms = np.stack([(np.roll(d, -1) - d) ** 2 / 2, kappa / TWO_PI**2 * bend])
    # The sum's own, and an ulp by which each site of the minimizing orbit misses being stationary.
    rounding = np.finfo(float).eps * (np.abs(terms).sum() + np.linalg.norm(d))
    return float(terms.sum()), float(rounding)
