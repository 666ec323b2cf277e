"""Judge rows of `judged_forcings.csv`: `python tests/judge_forcings.py ROW ROW ...`.

A row that is the image of another row is compared with it. Rows from the literature are accepted
unchecked. In every other row the script checks three statements, by methods independent of the
search for the last barrier:

1. A circle exists at `lower`. Newton's method in Fourier space (`nasm.circles`) must certify it,
   starting from the sites of a long periodic orbit, which this script computes with its own code.
   Only if the circle is too close to its breakup for that, `nasm.circles.hull` must certify it.
2. No circle exists at `upper`, or at five scales up to 1% above it. Converse KAM must eliminate all
   sampled starts within 10⁵ periods (`nasm.converse_kam`). In rows with the method "proof",
   interval arithmetic must also prove transport at `upper` (`nasm.proofs.transport`).
3. In rows with the method "residues" or "proof", the circle `omega` breaks at `value`. This script
   computes, with its own code, Greene's residues of the minimax orbits of the convergents of
   `omega`, starting from a circle just below the breakup. The scales at which the residues of two
   convergents agree must converge to `value`. They are extrapolated by Aitken's method; `error` is
   three times the larger of the last two changes of the extrapolated value.

Two options check a claim, and print it as a new row if the methods agree:

    --new CLASS PROFILE OMEGA NEAR [START]            circle OMEGA breaks near the scale NEAR
    --bracket CLASS PROFILE OMEGA LOWER UPPER [START] circle OMEGA exists at LOWER, none at UPPER

Strengths are separated by spaces. OMEGA and the scales in these options may come from any source.
"""

import sys
from math import cos, inf, isfinite, isnan, log, nan, pi, sin

import numpy as np
from judged import Row, image_row, table
from numba import njit

from nasm import circles
from nasm.circles import hull
from nasm.converse_kam import symmetry_line, transversal
from nasm.numbers import convergents, distinct_convergents, parse
from nasm.proofs import transport

STEPS = 100_000  # limit of converse KAM, in periods of the forcing
ABOVE = (0, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2)  # relative distances above `upper` that are checked
NEAREST = (1e-4, 3e-4, 1e-3)  # distances below a breakup at which circles are certified
SHORTEST, SITES = 20, 6000  # minimum q and maximum length, in kicks, of compared orbits
HULL = 60_000  # maximum number of sites of the orbit from which Newton's method starts


def eliminated(kappa, steps=STEPS):
    """Return True if converse KAM eliminates all sampled starts."""
    if symmetry_line.has_dominant_line(kappa):
        return symmetry_line.longest_lived(kappa, steps)[1] < inf
    return transversal.longest_lived(kappa, steps).kicks < inf


def circle_below(omega, start, profile, breakup, distance):
    """Return (scale, u) of a certified circle, scale ≤ breakup·(1 - distance), or (nan, None)."""
    return hull.certified_circle(omega, profile, breakup, distance, start)


def is_circle(omega, kappa):
    """Return True if Newton's method, started from a long periodic orbit, certifies ω's circle."""
    u = hull_functions(omega, kappa)
    return u is not None and circles.invariant_circle(omega, kappa, 65_536, u).certified


def hull_functions(omega, kappa):
    """Return the deviations of a long periodic orbit from uniform rotation, shape (P, n).

    One site of the orbit is held fixed. Return None if Newton's method does not find the orbit.
    """
    n_kicks, strongest = kappa.size, int(np.abs(kappa).argmax())
    kappa, chains = np.roll(kappa, -strongest), []
    for fraction in distinct_convergents(omega, HULL // n_kicks):
        p, q = fraction.as_integer_ratio()
        u = np.full(q * n_kicks, 0.0 if kappa[0] > 0 else 0.5)
        if len(chains) > 1:  # join the second-to-last orbit and copies of the last
            one, other = chains[-2:]
            often = (q - one[1].size // n_kicks) // (other[1].size // n_kicks)
            parts, turns = [], 0
            for whole, part in [one] + often * [other]:
                parts.append(turns + np.arange(part.size) * whole / part.size + part)
                turns += whole
            u = np.concatenate(parts) - np.arange(u.size) * p / u.size
        if not hold(kappa, p, q, u)[0]:
            return None
        chains.append((p, u))
    u = u.reshape(q, n_kicks).T
    phases = np.arange(q) * p % q
    # Sort by phase, shift so that ⟨u_0⟩ = 0, and begin with the first kick of the period.
    size, mean = 16_384, u[-strongest % n_kicks].mean()
    modes = np.fft.rfft((u - mean)[:, np.argsort(phases)])[:, : size // 3] / u.shape[1]
    shift = np.full(n_kicks, float(omega) * strongest / n_kicks - mean)
    shift[:strongest] -= float(omega)
    turns = np.exp(2j * pi * shift[:, None] * np.arange(modes.shape[1]))
    padded = np.zeros((n_kicks, size // 2 + 1), complex)
    padded[:, : modes.shape[1]] = np.roll(modes, strongest, axis=0) * turns
    return np.fft.irfft(padded, size) * size


@njit
def hold(kappa, p, q, u):
    """Apply Newton's method in place to a chain of Pq sites x_n = np/Pq + u_n; site 0 is fixed.

    Returns whether the method converges, the force on site 0, and Greene's residue.
    """
    n_sites = kappa.size * q
    force, inverse, curvature = np.empty(n_sites), np.empty(n_sites), np.empty(n_sites)
    last, converged = 1e300, False
    for _ in range(60):
        for n in range(n_sites):
            x = (n * p % n_sites) / n_sites + u[n]
            strength = kappa[n % kappa.size]
            kick = strength / (2 * pi) * sin(2 * pi * x)
            force[n] = u[(n + 1) % n_sites] - 2 * u[n] + u[n - 1] - kick
            curvature[n] = 2 + strength * cos(2 * pi * x)
        before = along = 0.0
        for n in range(1, n_sites):
            pivot = curvature[n] - before
            if pivot < 1e-9:
                pivot = 1.0  # the action is not convex here: step downhill
            before = inverse[n] = 1 / pivot
            along = force[n] = (force[n] + along) * before
        step = largest = 0.0
        for n in range(n_sites - 1, 0, -1):
            step = force[n] = force[n] + inverse[n] * step
            largest = max(largest, abs(step))
        part = 1.0 if largest < 0.3 / q else 0.3 / q / largest
        for n in range(1, n_sites):
            u[n] += part * force[n]
        if largest < 1e-13 or (largest < 1e-9 and largest > 0.5 * last):
            converged = True
            break
        last = largest
    a, b, c, d = 1.0, 0.0, 0.0, 1.0  # the tangent map
    for n in range(n_sites):
        x = (n * p % n_sites) / n_sites + u[n]
        slope = kappa[n % kappa.size] * cos(2 * pi * x)
        c, d = c + slope * a, d + slope * b
        a, b = a + c, b + d
    at_rest = u[1 % n_sites] - 2 * u[0] + u[-1] - kappa[0] / (2 * pi) * sin(2 * pi * u[0])
    return converged, at_rest, (2 - a - d) / 4


class MinimaxOrbits:
    """Minimax orbits of the convergents of a circle's ω, on κ = start + s·profile.

    u : deviations of the circle from uniform rotation, shape (P, n), at a scale just below its
    breakup. To find an orbit, one site is moved across a gap between neighbouring sites, at the
    place where the circle is stretched most. The orbit is then continued to other scales.
    """

    def __init__(self, omega, start, profile, u):
        self.omega, self.start, self.profile, self.u = omega, start, profile, u
        n = u.shape[1]
        stretch = (np.roll(u, -1, axis=1) - np.roll(u, 1, axis=1)) * n / 2
        self.site, first = map(int, np.unravel_index(stretch.argmax(), u.shape))
        self.phase, self.known, self.fractions = first / n, {}, []
        for fraction in convergents(omega):
            if profile.size * fraction.denominator > SITES:
                break
            self.fractions.append(fraction)

    def residue(self, i, scale):
        """Return Greene's residue R of the orbit of convergent i; NaN if no orbit is found."""
        q, known = self.fractions[i].denominator, self.known.setdefault(i, {})
        for below in (0, 0.05, 0.1, 0.2, 0.4, 0.8) if not known else ():
            at = scale * (1 - below / q)
            if result := self._sought(i, at):
                known[at] = result
                break
        if not known:
            return nan
        at = min(known, key=lambda other: abs(other - scale))
        while at != scale:
            step = scale - at
            for _ in range(6):
                step = np.clip(step, -0.05 / q * scale, 0.05 / q * scale)
                target = scale if step == scale - at else at + step
                if result := self._moved(i, target, known[at][0]):
                    break
                step /= 3
            else:
                return nan
            known[target], at = result, target
        return known[scale][1]

    def _kappa(self, scale):
        return np.roll(self.start + scale * self.profile, -self.site)

    def _moved(self, i, scale, u):
        """Return (u, R) of the orbit with deviations close to u; None if not found or R ≤ 0."""
        (p, q), kappa, u = self.fractions[i].as_integer_ratio(), self._kappa(scale), u.copy()
        x_before, x = u[0], u[0] + 1e-3 / q
        result, before, _ = hold(kappa, p, q, u)
        u[0] = x
        ok, force, residue = hold(kappa, p, q, u)
        if not (result and ok and force > before):  # the action has a minimum here, not a maximum
            return None
        for _ in range(30):
            if abs(x - x_before) < 1e-12 / q or abs(force) < 3e-17 or force == before:
                break
            step = -force * (x - x_before) / (force - before)
            if abs(step) > 0.3 / q:
                return None
            x_before, before, x = x, force, x + step
            u[0] = x
            ok, force, residue = hold(kappa, p, q, u)
            if not ok:
                return None
        return (u, residue) if residue > 0 else None

    def _sought(self, i, scale, places=16):
        """Return (u, R) of the orbit at the highest maximum of the action across a gap, or None."""
        (p, q), kappa = self.fractions[i].as_integer_ratio(), self._kappa(scale)
        n_kicks, n_sites = kappa.size, kappa.size * q
        site = (np.arange(n_sites) + self.site) % n_kicks
        period = (np.arange(n_sites) + self.site) // n_kicks
        x, force, chains = [], [], []
        for part in np.linspace(-0.6, 0.6, places + 1):
            first = self.phase + part / q
            phase = first + period * p % q / q
            place = phase % 1 * self.u.shape[1]
            cell = place.astype(int)
            here, ahead = (self.u[site, n % self.u.shape[1]] for n in (cell, cell + 1))
            u = here + (place - cell) * (ahead - here) + first + self.site * p / n_sites
            ok, at_rest, _ = hold(kappa, p, q, u)
            if not ok:
                return None
            x, force, chains = [*x, u[0]], [*force, at_rest], [*chains, u]
        work = [(a + b) / 2 * (y - x) for a, b, x, y in zip(force, force[1:], x, x[1:])]  # noqa: B905
        action = np.concatenate([[0], -np.cumsum(work)])
        maxima = [k for k in range(places) if force[k] < 0 <= force[k + 1]]
        if not maxima:
            return None
        k = max(maxima, key=lambda k: max(action[k : k + 2]))
        low, high, u = x[k], x[k + 1], chains[k].copy()
        for _ in range(8):
            u[0] = (low + high) / 2
            ok, at_rest, _ = hold(kappa, p, q, u)
            if not ok:
                return None
            low, high = (u[0], high) if at_rest < 0 else (low, u[0])
        return self._moved(i, scale, u)

    def agreement(self, i, later, near):
        """Return the scale at which convergents i and i + later have equal residues, or NaN.

        The secant method finds this scale.
        """
        q = self.fractions[i + later].denominator

        def difference(scale):
            one, other = (self.residue(k, scale) for k in (i, i + later))
            return log(other / one) if one > 0 and other > 0 else nan

        before, scale = near, near * (1 - 0.02 / q)
        was, is_ = difference(before), difference(scale)
        for _ in range(12):
            if isnan(was) or isnan(is_) or was == is_:
                return nan
            step = np.clip(-is_ * (scale - before) / (is_ - was), -0.5 / q * near, 0.5 / q * near)
            if abs(step) < 1e-13 * scale or (abs(is_) < 1e-11 and abs(step) < 1e-6 / q * near):
                return float(scale)
            before, was, scale = scale, is_, scale + step
            is_ = difference(scale)
        return float(scale) if abs(scale - before) < 1e-4 / q * near else nan


def breakup(omega, start, profile, near, tolerance=1e-5):
    """Locate the breakup of a circle near a scale, by residues.

    The search starts from a certified circle below the breakup. It returns the value, its error and
    the scale of that circle; all are NaN if the residues do not converge.
    """
    for distance in NEAREST:
        below, u = circle_below(omega, start, profile, near, distance)
        if u is None or below < near * (1 - 2 * distance):
            continue
        value, error = _limit(MinimaxOrbits(omega, start, profile, u), near)
        if error < tolerance * value:
            return value, error, below
    return nan, nan, nan


def _limit(orbits, near):
    scales, later = [], len(orbits.omega.tail)
    for i, fraction in enumerate(orbits.fractions[:-later]):
        if fraction.denominator >= SHORTEST:
            scale = orbits.agreement(i, later, scales[-1] if scales else near)
            if isfinite(scale):
                scales.append(scale)
    if len(scales) < 3:
        return (scales[-1], abs(scales[-1] - scales[-2])) if len(scales) == 2 else (nan, nan)
    first, second, third = (np.array(scales[k : len(scales) - 2 + k]) for k in range(3))
    limits = third - (third - second) ** 2 / (third - 2 * second + first)
    if limits.size < 3:
        return scales[-1], abs(scales[-1] - scales[-2])
    value = float(limits[-1])
    return value, float(max(*(3 * abs(np.diff(limits[-3:]))), 2e-9 * abs(value)))


def _has_circle(omega, start, profile, scale, breakup):
    if is_circle(omega, start + scale * profile):
        return True
    distance = 1 - scale / breakup
    if not 1e-6 <= distance <= 0.5:
        return False
    return circle_below(omega, start, profile, breakup, distance)[0] >= scale * (1 - 1e-12)


def doubts(row):
    """Return messages that state what the methods do not confirm about a row."""
    start = np.zeros(len(row.profile)) if row.start is None else np.array(row.start)
    profile, result = np.array(row.profile), []
    if row.image_of is not None:
        number, operations = row.image_of
        expected = image_row(row.number, row.kind, table()[number], operations)
        return [] if expected == row else [f"the image should be {expected.text()}"]
    if row.method == "literature":
        return []
    if not _has_circle(parse(row.omega), start, profile, row.lower, row.value):
        result.append(f"no circle of {row.omega} is certified at lower={row.lower!r}")
    if row.method == "proof" and not transport.prove(row.upper * profile, 300).proved:
        result.append(f"transport is not proved at upper={row.upper!r}")
    for above in ABOVE:
        scale = row.upper * (1 + above)
        if not eliminated(start + scale * profile):
            result.append(f"a start survives {STEPS} steps at {scale!r}")
    if row.method in ("residues", "proof"):
        value, error, _ = breakup(parse(row.omega), start, profile, row.value)
        if not abs(value - row.value) <= error + row.error:
            result.append(f"by residues, the circle breaks at {value!r} ± {error:.1g}")
    return result


def new_row(kind, profile, omega, near, start=None):
    """Return the Row for a ray whose last circle, `omega`, is claimed to break near a scale.

    Return None if the methods do not confirm the claim.
    """
    profile, omega = np.array(profile, float), parse(omega)
    first = np.zeros(profile.size) if start is None else np.array(start, float)
    value, error, lower = breakup(omega, first, profile, near)
    if not lower < value:
        return None
    for upper in (value * (1 + excess) for excess in (5e-5, 1e-4, 2e-4, 4e-4)):
        if all(eliminated(first + upper * (1 + above) * profile) for above in ABOVE):
            numbers = value, error, lower, upper
            return Row(0, kind, tuple(profile), start, *numbers, str(omega), "residues")
    return None


def new_bracket(kind, profile, omega, lower, upper, start=None):
    """Return the Row for a ray with a stated bracket; None if the methods do not agree.

    The claim is that the circle `omega` exists at `lower`, and no circle exists at `upper`.
    """
    numbers = (lower + upper) / 2, (upper - lower) / 2, lower, upper
    row = Row(0, kind, tuple(profile), start, *numbers, omega, "bracket")
    return None if doubts(row) else row


def strengths(text):
    return tuple(map(float, text.split()))


def main(arguments):
    if arguments[:1] in (["--new"], ["--bracket"]):
        option, kind, profile, omega, *others = arguments
        n = 1 if option == "--new" else 2
        scales, start = map(float, others[:n]), map(strengths, others[n:])
        judge = new_row if option == "--new" else new_bracket
        row = judge(kind, strengths(profile), omega, *scales, *start)
        print(row.text() if row else "the methods do not agree")
        return
    rows = table()
    for number in map(int, arguments or rows):
        result = doubts(rows[number])
        print(rows[number].text(), *(result or ["confirmed"]), sep="\n    ", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
