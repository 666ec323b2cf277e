"""The methods that `work_precision` compares, each as a function of its effort.

A method may return several scales from one computation, e.g. a bound and a better estimate.
"""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from math import cos, nan, radians

import numpy as np

from nasm import barriers, circles, escape, orbits, periodic, proofs
from nasm.circles import continuation as norms
from nasm.circles import hull
from nasm.converse_kam import symmetry_line, transversal
from nasm.numbers import RotationNumber
from nasm.symmetries import dominant_centre

JUDGE = 30_000
PROFILES = {"45": (1.0, 1.0), "0": (1.0, 0.0)} | {
    str(angle): (cos(radians(angle)), cos(radians(90 - angle))) for angle in (30, 40, 120)
}
PROFILES["three-kicks"] = 1.0, 0.7, 0.3


@dataclass(frozen=True)
class Ray:
    """A test problem: the last circle on the ray κ = s·profile breaks at s = value ± error.

    omega : the rotation number of this circle.
    """

    profile: tuple
    omega: RotationNumber
    value: float
    error: float


@dataclass
class Method:
    """A method, and the efforts at which it is measured."""

    answers: tuple[str, ...]  # names of its results
    effort: str  # letter or name of its effort
    efforts: list  # values of the effort; the last one is used in full runs only
    run: Callable  # (ray, effort) → (scale, estimated error) for each of `answers`


def judged(name):
    """Return the Ray of that name, with its reference value from residues."""
    profile = PROFILES[name]
    omega = barriers.critical_scale(profile, 1e-2).omega
    judge = periodic.critical_scale(omega, profile, JUDGE)
    return Ray(profile, omega, judge.value, judge.error)


def direct(n_orbits, reach, precision="double"):
    """Return the method of direct iteration; leaving [-reach, 0.3 + reach] counts as transport."""

    def run(ray, n_max):
        settings = n_orbits, (-reach, 0.3 + reach), precision
        return _bound_and_value(escape.critical_scale(ray.profile, n_max, *settings))

    return run


def converse_kam(ray, n_max):
    """Return the scale at which converse KAM eliminates all starts, and an extrapolated value."""
    if symmetry_line.has_dominant_line(np.array(ray.profile)):
        return _bound_and_value(symmetry_line.critical_scale(ray.profile, n_max))
    upper, longest = transversal.upper_scale(ray.profile, n_max)
    excess = np.array(transversal.EXCESS_BOUNDS[::-1]) * len(ray.profile) / longest.kicks
    least, most = upper * (1 - excess)
    return (upper, upper - least), ((least + most) / 2, (most - least) / 2)


def _bound_and_value(scale):
    return (scale.upper, scale.upper - scale.value + scale.error), (scale.value, scale.error)


def crossing(ray, q_max):
    """Return the scale of the last crossing of residues, and its change from the previous one."""
    _, scales = periodic.crossings(ray.omega, ray.profile, q_max)
    return ((scales[-1], abs(scales[-1] - scales[-2])) if scales.size else (nan, nan),)


def of_circle(critical_scale):
    """Convert a function of ω, a profile and an effort into a method."""

    def run(ray, effort):
        scale = critical_scale(ray.omega, ray.profile, effort)
        return ((scale.value, scale.error),)

    return run


def last_circle(ray, n_points):
    """Find the largest scale at which the circle is certified with `n_points` points."""
    start = None

    def exists(scale):
        nonlocal start
        kappa = scale * np.array(ray.profile)
        circle = circles.invariant_circle(ray.omega, kappa, n_points, start)
        start = circle.u if circle.certified else start
        return circle.certified

    largest = 2 / max(map(abs, ray.profile))  # no circle exists at this scale
    return ((_last(exists, 0.0, largest, 0.1 / n_points), nan),)


def birkhoff(ray, n):
    """Find the largest scale at which converse KAM's longest-lived orbit looks quasiperiodic.

    An orbit looks quasiperiodic if its rotation number is known to five digits and is not a
    fraction with q ≤ 200; in an island chain it is such a fraction. This does not show that a
    circle exists: island chains of longer period and cantori look the same.
    The search stays within 10% of the value from converse KAM, because regular orbits also exist
    beyond the breakup. The result is NaN if the ray has no dominant symmetry line.
    """
    profile = np.array(ray.profile)
    if not symmetry_line.has_dominant_line(profile):
        return ((nan, nan),)
    site, a = dominant_centre(profile)

    def quasiperiodic(scale):
        y, _ = symmetry_line.longest_lived(scale * profile, n)
        omega, digits = map(float, orbits.rotation_number(scale * np.roll(profile, -site), a, y, n))
        if omega != omega:
            return False
        return abs(omega - Fraction(omega).limit_denominator(200)) > 10 * 10**-digits

    near = symmetry_line.critical_scale(profile, 100).value
    return ((_last(quasiperiodic, 0.9 * near, 1.1 * near, 0.1 / n), nan),)


def _last(holds, low, high, precision):
    """Bisect for the scale up to which `holds` is true, to a given relative precision."""
    while high - low > precision * high:
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def barrier(ray, tol):
    """Return the lower end and the width of the bracket, and the value with its error."""
    scale = barriers.critical_scale(ray.profile, tol)
    return (scale.lower, scale.upper - scale.lower), (scale.value, scale.error)


def transport_proof(ray, excess):
    """Prove that transport is global at a relative distance `excess` beyond the breakup."""
    scale = (1 + excess) * ray.value
    proof = proofs.transport.prove(scale * np.array(ray.profile), 1000.0)
    return ((scale if proof.proved else nan, excess * ray.value),)


def barrier_proof(ray, distance):
    """Prove that the circle exists at a relative distance `distance` below its breakup."""
    _, near = hull.certified_circle(ray.omega, ray.profile, ray.value, distance)
    scale = (1 - distance) * ray.value
    options = {"start": near, "budget": 1000.0}
    proof = proofs.barrier.prove(ray.omega, scale * np.array(ray.profile), **options)
    return ((scale if proof.proved else nan, distance * ray.value),)


STEPS = [1000, 10_000, 100_000, 1_000_000]
PERIODS = [30, 100, 300, 1000, 3000, 10_000]
POINTS = [64, 256, 1024, 4096, 16_384]
TOLERANCES = [1e-1, 1e-2, 1e-3, 1e-4]
DIRECT = ["direct", "direct, 100 orbits", "direct, 100 orbits, near exit"]
DIRECT += ["direct, 100 orbits, single precision"]
ALL, HUNDRED, NEAR, SINGLE = ((name, f"{name}, extrapolated") for name in DIRECT)
CONES = "converse KAM, upper bound", "converse KAM, value"
BLOW_UP, AITKEN = map(of_circle, (norms.critical_scale, periodic.critical_scale))
BARRIERS = "last barrier, bracket", "last barrier, value"
METHODS = {
    "direct": Method(ALL, "N", STEPS, direct(10_000, 2.0)),
    "direct-100": Method(HUNDRED, "N", STEPS, direct(100, 2.0)),
    "direct-window": Method(NEAR, "N", STEPS, direct(100, 1.2)),
    "direct-single": Method(SINGLE, "N", STEPS, direct(100, 2.0, "single")),
    "cones": Method(CONES, "N", [100, *STEPS], converse_kam),
    "birkhoff": Method(("weighted Birkhoff average",), "n", STEPS, birkhoff),
    "circle": Method(("last certified circle",), "points", POINTS, last_circle),
    "continuation": Method(("blow-up of circles",), "tol", [*TOLERANCES, 1e-5, 1e-6], BLOW_UP),
    "crossing": Method(("residue, last crossing",), "q", PERIODS, crossing),
    "residue": Method(("residue, Aitken",), "q", PERIODS, AITKEN),
    "barriers": Method(BARRIERS, "tol", [*TOLERANCES, 2e-5], barrier),
    "transport-proof": Method(("transport proved",), "ε", [0.1, 0.01, 1e-3, 3e-4], transport_proof),
    "barrier-proof": Method(("barrier proved",), "ε", [0.1, 0.01, 3e-3, 1e-3], barrier_proof),
}
