"""Compute ordered periodic orbits by brute force, to test `nasm.action` independently.

A chain of N = Pq sites x_j with x_{j+N} = x_j + p is an orbit if x_{j+1} - 2x_j + x_{j-1} equals
the kick (κ_j/2π) sin 2πx_j at each site. The orbit is ordered if, for each site of the
period, its q points at that site are in the order of a rotation.
"""

import math

import mpmath
import numpy as np
from numba import njit


def residue(kappa, x):
    """Return the residue R, from the product of the tangent maps at mpmath's working precision."""
    matrix = mpmath.eye(2)
    for strength, at in zip(kappa, x, strict=True):
        c = mpmath.mpf(strength) * mpmath.cospi(2 * at)
        matrix = mpmath.matrix([[1 + c, 1], [c, 1]]) * matrix
    return float((2 - matrix[0, 0] - matrix[1, 1]) / 4)


def is_ordered(x, period, p, q):
    whole, rest = np.divmod(np.arange(q) * p, q)
    for site in range(period):
        at = (np.asarray(x[site::period], float) - whole)[np.argsort(rest)]
        if not (np.diff(at, append=at[0] + 1) > -1e-9).all():
            return False
    return True


def hessian(kappa, x):
    matrix = np.diag(2 + kappa * np.cos(2 * np.pi * x))
    for j in range(x.size):
        matrix[j, (j + 1) % x.size] -= 1
        matrix[(j + 1) % x.size, j] -= 1
    return matrix


def on_symmetry_lines(kappa, p, q):
    """Return residues, computed to 25 digits, of ordered orbits with a point on a symmetry line.

    This works for forcings of one or two kicks. The orbits satisfy x_j + x_{-j} = 2c about a site
    or, with one kick, x_j + x_{-1-j} = 2c about the midpoint of two sites, where 2c = 0 or 1.
    """
    n_sites, result = len(kappa) * q, []
    centres = [(site, twice, 0) for site in range(len(kappa)) for twice in (0, 1)]
    centres += [(0, twice, 1) for twice in (0, 1) if len(kappa) == 1]
    for site, twice, between in centres:
        strengths = np.resize(np.roll(kappa, -site), n_sites)
        middle = n_sites - between

        def chain(d, n, sine, pi, twice=twice, between=between, strengths=strengths):
            before, at, x = twice / 2 - d, twice / 2 + between * d, []
            for strength in np.resize(strengths, n):
                x.append(at)
                before, at = at, 2 * at - before + strength / (2 * pi) * sine(at)
            return x

        def miss(d, *functions, chain=chain, middle=middle, twice=twice):
            x = chain(d, (middle + 1) // 2 + 1, *functions)
            return x[middle // 2] + x[(middle + 1) // 2] - twice - p

        exact = (lambda x: mpmath.sinpi(2 * x)), mpmath.pi
        # d is the distance between adjacent sites near the centre, halved if the centre is between
        # two sites. An ordered orbit stays within one turn of the rotation, so d is in this range.
        d = (p / n_sites + np.linspace(-0.7, 0.7, 140_001)) / (1 + between)
        values = miss(d, lambda x: np.sin(2 * np.pi * x), np.pi)
        for i in np.flatnonzero(values[1:] * values[:-1] <= 0):
            with mpmath.workdps(25):
                ends = mpmath.mpf(d[i]), mpmath.mpf(d[i + 1])
                try:
                    at = mpmath.findroot(lambda d: miss(d, *exact), ends, solver="anderson")  # noqa: B023
                except ValueError:
                    continue
                x = chain(at, n_sites, *exact)
                if is_ordered(x, len(kappa), p, q):
                    result.append(residue(strengths, x))
    return result


@njit
def _forces(kappa, p, x, force):
    n = x.size
    for j in range(n):
        left = x[j - 1] if j else x[n - 1] - p
        right = x[j + 1] if j < n - 1 else x[0] + p
        force[j] = left + right - 2 * x[j] - kappa[j] / (2 * math.pi) * math.sin(2 * math.pi * x[j])


@njit
def _minimize_others(kappa, p, x):
    """Minimize the action over all sites but x_0, in place; return True on convergence.

    Newton's method is used where the action is convex; elsewhere sites are moved one by one.
    """
    n = x.size
    force, inverse, step, last = np.empty(n), np.empty(n), np.empty(n), np.inf
    for _ in range(300):
        if n == 1:
            return True
        _forces(kappa, p, x, force)
        convex, before, along = True, 0.0, 0.0
        for j in range(1, n):
            pivot = 2 + kappa[j] * math.cos(2 * math.pi * x[j]) - before
            if pivot < 1e-12:
                convex = False
                break
            before = inverse[j] = 1 / pivot
            along = step[j] = (force[j] + along) * before
        if convex:
            for j in range(n - 2, 0, -1):
                step[j] += step[j + 1] * inverse[j]
            largest = np.abs(step[1:]).max()
            x[1:] += step[1:] * min(1.0, 0.02 / max(largest, 1e-300))
            if largest < 1e-15 * n or (largest < 1e-9 and largest > 0.5 * last):
                return True
            last = largest
        else:
            last = np.inf
            for _ in range(50):
                for j in range(1, n):
                    kick = kappa[j] / (2 * math.pi) * math.sin(2 * math.pi * x[j])
                    right = x[j + 1] if j < n - 1 else x[0] + p
                    x[j] += (x[j - 1] + right - 2 * x[j] - kick) / (2 + abs(kappa[j]))
    return False


def by_scan(kappa, p, q, per_gap=20):
    """Return residues of ordered orbits, found by a dense scan over x_0 at each site of the period.

    For each x_0 the other sites are chosen so that they minimize the action. Where the force on x_0
    changes sign, Newton's method is used to find an orbit.
    """
    kappa, result = np.asarray(kappa, float), []
    for site in range(kappa.size):
        strengths, before = np.tile(np.roll(kappa, -site), q), None
        force = np.empty(strengths.size)
        for x_0 in (np.arange(per_gap * q + 1) + 0.37) / (per_gap * q):
            x = x_0 + np.arange(strengths.size) * p / strengths.size
            if not _minimize_others(strengths, p, x) or not is_ordered(x, kappa.size, p, q):
                before = None
                continue
            _forces(strengths, p, x, force)
            if before is not None and before[1] * force[0] <= 0:
                _polish(strengths, p, q, (before[0] + x) / 2, kappa.size, result)
            before = x.copy(), force[0]
    return result


def _polish(strengths, p, q, x, period, found):
    force, step = np.empty(x.size), np.inf
    for _ in range(20):
        _forces(strengths, p, x, force)
        matrix = hessian(strengths, x)
        if np.abs(step).max() < 1e-14 or abs(np.linalg.det(matrix)) < 1e-300:
            break
        step = np.linalg.solve(matrix, force)
        x = x + step
    index = int((np.linalg.eigvalsh(hessian(strengths, x)) < 0).sum())
    if np.abs(step).max() < 1e-10 and index < 2 and is_ordered(x, period, p, q):
        found.append(residue(strengths, [mpmath.mpf(at) for at in x]))


def misses(orbit, kappa, p, q, kind):
    """Describe the first check that an Orbit fails; return "" if it passes all checks.

    The force on each site must vanish, and the orbit must be ordered. The Hessian of the action
    must have one negative eigenvalue at a minimax orbit, and none at a minimizing one.
    """
    x, strengths = orbit.sites(), np.tile(np.roll(kappa, -orbit.site), q)
    force = np.empty(x.size)
    _forces(strengths, float(p), x, force)
    curvatures = np.linalg.eigvalsh(hessian(strengths, x))
    if np.abs(force).max() > 1e-12:
        return f"a force of {np.abs(force).max()}"
    if not is_ordered(x, len(kappa), p, q):
        return "not ordered"
    if np.abs(curvatures).min() > 1e-9 and (curvatures < 0).sum() != kind:
        return f"curvatures {curvatures[:3]}"
    return ""
