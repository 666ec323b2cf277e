"""A barrier exists: the invariant circle of ω under one forcing, proved in ball arithmetic.

    E_j(φ) = g_{j+1}(φ + α) - 2g_j(φ) + g_{j-1}(φ - α) - (κ_j/2π) sin 2πg_j(φ),      α = ω/P,

where g_j(φ) = φ + u_j(φ), u_{j+P} = u_j: the chain of `nasm.circles` with g_j(θ + jα) = h_j(θ).
Trigonometric polynomials u_j for which E is small enough have a true circle near them; "small
enough" is the theorem of proofs/README.md, "A barrier exists". With ‖f‖ = Σ_k |f_k| e^{2π|k|ρ} its
hypotheses are upper bounds of

    n_j ≥ ‖g_j'‖,    p_j ≥ ‖1/g_j'‖,    k_j ≥ ‖e^{2πig_j}‖,    ε ≥ Σ_j n_j ‖E_j‖,    C ≥ C_R + δ.

What a proof rests on: FLINT's balls (python-flint, the extra `proof`), and the functions from
`_omega_ball` to `balls`. There every number that enters a bound is a ball or an exact dyadic;
floats only choose (ρ, ρ̂, where sums are cut, the polynomial near 1/g_j'), and any choice is sound.
How u was found does not matter: `refined` and what follows it may do as they like.

For P ≤ 2 the u_j are odd, as h_j(θ) → -h_{-j}(-θ) maps circles to circles. Then all is real, and
one transform stands for two functions.
"""

import time
from copy import copy
from dataclasses import dataclass, field
from functools import lru_cache, reduce
from itertools import islice
from math import ceil, inf, log, nan, pi, sqrt

import numpy as np

from nasm import circles
from nasm.checks import count, positive, real
from nasm.circles import continuation, fourier
from nasm.critical import Result
from nasm.maps import MAX_STRENGTH, MIN_SIZE, direction, forcing
from nasm.numbers import RotationNumber, as_rotation_number, convergents
from nasm.proofs.certificates import certificate, in_hex
from nasm.symmetries import shorten

__all__ = ["BarrierProof", "need_flint", "prove", "proved_lower"]

try:
    from flint import acb, acb_poly, arb, arb_poly, ctx
except ImportError:  # the extra `proof`
    arb = None  # type: ignore[assignment, misc]

KEPT = 0.38  # modes of u, in parts of the grid
_STEPS = 6  # of Newton's method in balls, of which 0 to 3 are needed
_LARGEST = 2**22  # points of a grid
_SECONDS = 1e-5  # of computing, for a point and kick on a fast machine
_ROUNDED = 46  # e^-46 is 10^-20, a bit of long doubles near 0.1


@dataclass(frozen=True, eq=False)
class BarrierProof(Result):
    """Whether a rotational invariant circle of omega is proved to exist under kappa; or in a fan,
    under s(kappa + t·tilt) for all s from one scale to the other and all t from -1 to 1.

    proved : bool. why : str, "" if proved, else "not proved: " and the reason.
    omega : RotationNumber per period. kappa : tuple of P floats, exact.
    short_omega, short_kappa : of the shorter map (`symmetries.shorten`) in which it was proved;
        nothing is shortened where tilt is not 0.
    tilt : tuple, of as many numbers as short_kappa. scales : two floats. Of a fan; else empty.
    n : int, points of the grid. rho : float, width of the strip where E was bounded; NaN if none
        was. constants : dict of floats, rounded upper bounds, for all s and t at once: see
        proofs/README.md.
    unit : int, and moves : list [m][l][j] of [re, im], lists of ints: u_j = Σ C_jml T_m(σ) T_l(t),
        and C_jml has the modes (re[k] + i im[k])·2^unit, k ≥ 0; what is not in a list is 0. Under
        one forcing m = l = 0.
    """

    proved: bool
    why: str
    omega: RotationNumber
    kappa: tuple[float, ...]
    short_omega: RotationNumber
    short_kappa: tuple[float, ...]
    tilt: tuple[float, ...] = ()
    scales: tuple[float, ...] = ()
    n: int = 0
    rho: float = nan
    constants: dict = field(default_factory=dict, repr=False)
    unit: int = 0
    moves: list = field(default_factory=list, repr=False)

    def certificate(self):
        """What another program needs to check the proof; ValueError if nothing was proved."""
        fields = {
            "shortened_from": {"omega": str(self.omega), "kappa": in_hex(self.kappa)},
            "omega": str(self.short_omega),
            "kappa": in_hex(self.short_kappa),
            "rho": self.rho.hex(),
            "moves": {"unit": self.unit, "numbers": self.moves},
        }
        theorem = "A barrier exists"
        if self.scales:
            fields |= {"tilt": in_hex(self.tilt), "scales": in_hex(self.scales)}
            theorem = "A barrier exists in a fan"
        about = self.kappa, self.tilt, self.omega, self.scales
        return certificate(self, theorem, fields, *about)


def prove(omega, kappa, n=None, start=None, budget=20.0):
    """Prove that the circle of rotation number omega exists under the forcing kappa.

    1. Take the shorter map, where the forcing repeats itself.
    2. Find the circle in doubles: `start`, or `circles.invariant_circle`.
    3. Newton's steps, the linear algebra in doubles, the residual E in balls.
    4. After each residual try to verify the theorem with it. If that fails for want of grid points,
       again with a third more, as long as the budget lasts.

    Parameters
    ----------
    omega : RotationNumber or its text, irrational; e.g. "gamma".
    kappa : sequence of P floats, taken as the exact binary fractions that they are.
    n : int, even, 64 to 4194304, points of the grid; default by the decay of the circle's modes.
    start : ndarray (P, m), deviations near the circle of the forcing, or of a shortened one, whose
        rows are its first.
    budget : float, CPU seconds; a grid that would take longer is not tried.

    Returns
    -------
    BarrierProof. proved=False says nothing about whether the circle exists. Not for several threads
    at once: FLINT's precision belongs to the process.

    ImportError without python-flint. ValueError if omega is no RotationNumber, kappa is no forcing,
    or another argument is out of range.
    """
    omega = as_rotation_number(omega)
    kappa = forcing(kappa)
    budget = positive("budget", budget, "seconds of computing time")
    if n is not None and count("n", n, 64, _LARGEST) % 2:
        raise ValueError(f"n={n} must be even, the points of a grid")
    need_flint()
    (short,), short_omega = shorten([kappa], omega)
    about = {"omega": omega, "kappa": tuple(kappa.tolist())}
    about |= {"short_omega": short_omega, "short_kappa": tuple(short.tolist())}
    if omega.is_rational:
        why = "not proved: omega is rational, so its circles are no barriers"
        return BarrierProof(False, why, **about)
    until = time.thread_time() + budget
    if start is None:
        circle = circles.invariant_circle(short_omega, short, 2**16)
        if not circle.certified:
            why = f"not proved: no circle was found: {circle.status.value}"
            return BarrierProof(False, why, **about)
        start = circle.u
    else:
        start = np.asarray(start, dtype=float)
        rows = range(short.size, kappa.size + 1, short.size)  # strengths may round to equal ones
        if start.ndim != 2 or start.shape[0] not in rows or not start.size:
            raise ValueError(
                f"start has shape {start.shape}; deviations of the shortened forcing "
                f"{short.tolist()} are {short.size} functions on a grid"
            )
        start = start[: short.size]
    if not np.isfinite(start).all():
        return BarrierProof(False, "not proved: the start is not finite", **about)
    return _proved(short_omega, short, start, n, until, about)


def proved_lower(omega, profile, value, budget):
    """The largest scale s at which the circle of omega is proved to exist on the ray s·profile.

    Circles nearer and nearer to the breakup are proved until the time is used up: the work grows
    like the power -1.2 to -1.4 of the distance. A proof at s says that a circle exists at exactly
    s·profile as rounded to doubles, and nothing of smaller scales: no theorem says that a circle
    does not break and come back on the way.

    Parameters
    ----------
    omega : RotationNumber, irrational. profile : sequence of P floats, not all zero.
    value : float, 1e-300 to 1e306, where the circle breaks, e.g. by `periodic.critical_scale`. It
        says only where to look.
    budget : float, CPU seconds to spend, as nearly as can be foreseen; 0.1 s reach 0.95 of the
        breakup, 1 s 0.99 and more, and from there the way left shrinks as the time grows.

    Returns
    -------
    scale : float; NaN if nothing was proved.
    proof : BarrierProof there, whose kappa are the exact doubles; the one that failed if scale is
    NaN, None if not even a circle in doubles was found.

    ImportError without python-flint; ValueError for a bad argument.
    """
    omega, profile = as_rotation_number(omega), direction(profile)
    value = real("value", value, MIN_SIZE, MAX_STRENGTH / MIN_SIZE)
    budget = positive("budget", budget, "seconds of computing time")
    need_flint()
    (short,), short_omega = shorten([profile], omega)
    best, best_proof, distance, until = nan, None, 0.05, time.thread_time() + budget
    while 1e-6 <= distance <= 0.5:
        before = time.thread_time()
        scale, u = continuation.certified_circle(short_omega, short, value, distance)
        proof = u is not None and prove(
            omega, scale * profile, start=u, budget=max(until - before, 1e-3)
        )
        now = time.thread_time()
        if proof and proof.proved and not scale <= best:
            best, best_proof = scale, proof
            closer = min(16, (max(until - now, 0) / (1.1 * (now - before))) ** 0.7)
            distance /= closer if closer > 1.1 else inf
        elif best_proof is None or not best_proof.proved:
            best_proof, distance = proof or None, 2 * distance
        else:  # halfway back
            distance = sqrt(distance * (1 - best / value))
            if distance > 0.9 * (1 - best / value) or now > until:
                break
    return best, best_proof


def need_flint():
    """ImportError, with the name "flint", unless python-flint is installed."""
    if arb is None:
        message = "a proof needs python-flint: pip install 'nasm-transport[proof]'"
        raise ImportError(message, name="flint")


def _proved(omega, kappa, start, n, until, about):
    size, before = n or grid_size(start), None
    while True:
        seconds = _SECONDS * size * kappa.size
        if not n and (size > _LARGEST or seconds > until - time.thread_time()):
            why = f"not proved: {size} points are beyond the budget: some {seconds:.1g} seconds"
            return BarrierProof(False, why, **about, n=size)
        with ctx.workprec(128 if size < 2**18 else 160):
            found = refined(Grid(omega, kappa.tolist(), size), start)
        least = found.pop("least", inf)
        proof = BarrierProof(**about, n=size, **found)
        if proof.proved or n or (before is not None and not least < 0.5 * before):
            return proof
        size, before = fast_size(4 * size // 3), least


# --- the rotation number --------------------------------------------------------------------------


def _omega_ball(omega, bits):
    """ω as a ball: |ω - p_n/q_n| < 1/(q_n q_{n+1}), with q_n q_{n+1} > 2^bits."""
    last = None
    for f in convergents(omega):
        if last is not None and last.denominator * f.denominator >> bits:
            radius = arb(1) / (last.denominator * f.denominator)
            return arb(last.numerator) / last.denominator + arb(0, 1) * radius
        last = f


@lru_cache(maxsize=64)
def _divisors(omega):
    """(q_n, |e^{2πiq_nω} - 1|, whether the last period bounds what follows) for n = 0, 1, …, to 40
    quotients or more, and a whole period, into the tail."""
    length = len(omega.tail)
    last = len(omega.prefix) + (40 // length + 2) * length
    found = [*islice(convergents(omega), last)]
    bits = 2 * max(map(abs, found[-1].as_integer_ratio())).bit_length() + 64
    with ctx.workprec(bits):
        ball = _omega_ball(omega, bits)
        return [
            (f.denominator, 2 * abs((ball * f.denominator).sin_pi()), n >= last - length)
            for n, f in enumerate(found)
        ]


def _russmann(omega, delta):
    """C_R = sup δ'σ(δ') over 0 < δ' ≤ δ, σ(δ) = sup_k e^{-2πkδ}/|e^{2πikω} - 1|: see the README.

    The peaks of the last period, whatever delta is, bound those of all later ones but for 10⁻⁶.
    """
    worst, two_pi = arb(0), 2 * arb.pi()
    for q, divisor, ends in _divisors(omega):
        if not ends and 1 / (two_pi * q) > delta:
            term = delta * (-two_pi * q * delta).exp() / divisor
        else:
            term = 1 / (two_pi * arb(1).exp() * q * divisor)
        worst = worst.max(term * (1 + arb(10) ** -6) if ends else term)
    return worst


# --- the residual ---------------------------------------------------------------------------------


class Grid:
    """The chain of P sites on n points: what `residual` needs again and again, in balls."""

    def __init__(self, omega, kappa, n):
        self.omega, self.n, self.sites, self.odd = omega, n, len(kappa), len(kappa) <= 2
        self.kappa = [arb(k) for k in kappa]
        alpha, half = _omega_ball(omega, ctx.prec + 40) / self.sites, n // 2
        phases = [2 * alpha * k for k in range(half)]
        if self.odd:  # u_{j+1}(φ + α) + u_{j-1}(φ - α), both sites being the same
            self.turn = [2 * x.cos_pi() for x in phases]
        else:
            self.turn = [acb(x).exp_pi_i() for x in phases]
        self.angles = [arb(2 * i) / n for i in range(half if self.odd else n)]

    def under(self, kappa):
        """The grid of other strengths, balls."""
        other = copy(self)
        other.kappa = kappa
        return other

    def samples(self, modes):
        """Values of real functions at φ = i/n, i < n/2 if they are odd, else i < n."""
        rows = [row + [arb(0)] * (self.n // 2 - len(row)) for row in modes]
        if self.odd:
            return self._sines(rows)
        ends = [([acb(x).conjugate() for x in row], row[:0:-1]) for row in rows]
        return [[v.real for v in acb.dft([*low, arb(0), *high])] for low, high in ends]

    def modes(self, values):
        """Modes 0, …, n/2 - 1, aliased, of the real functions with these values."""
        rows = self._sines(values) if self.odd else map(acb.dft, values)
        return [[x / self.n for x in row[: self.n // 2]] for row in rows]

    def _sines(self, rows):
        """2 Σ_k x_k sin(2πki/n), i < n/2, of one or two rows of n/2 reals with x_0 = 0."""
        x = [acb(*pair) for pair in zip(*rows, strict=True)]
        y = acb.dft([*x, arb(0), *(-v for v in x[:0:-1])])[: self.n // 2]  # -i times that
        return [[-v.imag for v in y], [v.real for v in y]][: len(rows)]


def residual(grid, u):
    """Modes 0, …, n/2 - 1 of E_j, in which those of the sine are aliased."""
    sines = [
        [(angle + 2 * x).sin_pi() for angle, x in zip(grid.angles, row, strict=True)]
        for row in grid.samples(u)
    ]
    E = []
    for j, sine in enumerate(grid.modes(sines)):
        strength = -grid.kappa[j] / (2 * arb.pi())
        row = [strength * x for x in sine]
        after, before = u[(j + 1) % grid.sites], u[j - 1]
        for k, (own, a, b, turn) in enumerate(zip(u[j], after, before, grid.turn, strict=False)):
            neighbours = a * turn if grid.odd else a * turn + b * turn.conjugate()
            row[k] += neighbours - 2 * own
        E.append(row)
    return E


# --- the theorem ----------------------------------------------------------------------------------


def norm(a, rho):
    """‖f‖_ρ = Σ|f_k| e^{2π|k|ρ} of a real f with |f_k| ≤ a_k, k ≥ 0."""
    return 2 * arb_poly(a)((2 * arb.pi() * rho).exp()) - a[0]


def slope_modes(row, odd):
    """Modes of g_j' = 1 + u_j'."""
    factor = 2 * arb.pi() if odd else 2 * arb.pi() * acb(0, 1)
    return [arb(1), *(factor * k * x for k, x in enumerate(row[1:], 1))]


def bounds_of_the_residual(grid, u, E, rho, rho_hat, cut):
    """Upper bounds of ‖E_j‖_ρ. u, E: bounds of the modes' sizes.

    |sin 2πg_j| ≤ M for |Im φ| ≤ ρ̂, so its modes are below M e^{-2πρ̂|k|}. Those of |k| < cut are
    taken from E, with their aliases, which are k + n, k - n, …; the others have no u_k in them.
    """
    n, two_pi, bounds = grid.n, 2 * arb.pi(), []
    if not (max(map(len, u)) <= cut <= n // 2 and 0 < rho < rho_hat):
        raise ValueError(f"cut={cut}, rho={rho}, rho_hat={rho_hat} are out of range")
    r, r_hat = (two_pi * rho).exp(), (two_pi * rho_hat).exp()
    q, less = r / r_hat, 1 - (-two_pi * rho_hat * n).exp()
    aliases = 1 / (1 - q) + (two_pi * cut * (rho + rho_hat)).exp() / (r * r_hat - 1)
    aliases *= 2 * (-two_pi * n * rho_hat).exp() / less
    rest = 2 * (two_pi * cut * (rho - rho_hat)).exp() / (1 - q)
    for a, e, kappa in zip(u, E, grid.kappa, strict=True):
        polynomial = arb_poly(a)
        M = (two_pi * (rho_hat + polynomial(r_hat) - polynomial(1 / r_hat))).cosh()
        bounds.append(norm(e[:cut], rho) + abs(kappa) / two_pi * M * (aliases + rest))
    return bounds


def bound_of_the_inverse(slope, near, rho, odd, kept, moved=0):
    """p ≥ ‖1/g'‖_ρ = ‖d/(1 - (1 - g'd))‖ by d, doubles near the modes of 1/g'; inf if it is poor.

    For all g' with ‖g' - slope‖ ≤ moved at once. g'd is multiplied out for the first `kept` modes
    of slope, the others are bounded.
    """
    d = [arb(x.real) if odd else acb(x.real, x.imag) for x in near]
    sizes = [x.abs_upper() for x in slope]
    beyond = norm([arb(0)] * kept + sizes[kept:], rho) if kept < len(slope) else 0
    both = [both_sides(half, odd) for half in (slope[:kept], d)]
    product, middle = both[0] * both[1], len(slope[:kept]) + len(d) - 2
    defect = [product[middle + k] for k in range(middle + 1)]
    defect[0] -= 1
    size = norm([x.abs_upper() for x in d], rho)
    small = norm([x.abs_upper() for x in defect], rho) + (beyond + moved) * size
    return size / (1 - small) if small < 1 else arb.pos_inf()


def both_sides(half, odd):
    if odd:
        return arb_poly(half[:0:-1] + half)
    return acb_poly([acb(x).conjugate() for x in half[:0:-1]] + half)


def inequalities(omega, kappa, rho, eps, n, p, k, part=1):
    """The names of those of the theorem's inequalities that fail, and the left sides of all; and
    the largest |κ_j|, δ, C and ε.

    part : of the right sides, below which the left ones are asked to be; at most 1.
    """
    two_pi, e = 2 * arb.pi(), arb(1).exp()
    eps = eps.max(arb(2) ** -1000)  # any upper bound will do; and 0 would give 0/0
    tau, eta, given = arb(1) / 10, arb(1) / 100, arb(99) / 100
    delta = given * rho / (4 + 2 * tau)
    C = _russmann(omega, delta) + delta
    q = [a * b for a, b in zip(p, p[1:] + p[:1], strict=True)]
    w = 2 * C**2 * sum(q) * (1 + eta) ** 2  # ‖w_j‖ ≤ w ε/δ²
    x = [two_pi * (1 + eta) * a * w * eps / delta**2 for a in n]  # 2π‖v_j‖
    ratio = w * eps / (2 * e * delta**3)
    for a, b, strength, y in zip(n, k, kappa, x, strict=True):
        taylor = b * (arb(0.5) + y / 6) * y.exp() * y**2
        ratio += a * abs(strength) / two_pi * (1 + eta) * taylor / eps
    chi = arb(4) / 3 * (1 + eta) * w * eps / (e * tau * delta**3)
    room, moved = arb(0), arb(0)
    for a, b, c, y in zip(q, n, n[1:] + n[:1], x, strict=True):
        room = room.max(a * b * c * (2 * chi + chi**2))
        moved = moved.max((4 * y / 3).expm1())
    left = {"ratio": ratio, "chi": chi, "room": room, "moved": moved}
    right = {"ratio": arb(1) / 32, "chi": eta, "room": eta / (1 + eta), "moved": eta}
    failed = [name for name in left if not left[name] < part * right[name]]
    largest = reduce(arb.max, map(abs, kappa))
    return failed, left | {"kappa": largest, "delta": delta, "C": C, "epsilon": eps}


def verified(grids, u, E, sizes, apart, kappa, between, part=1):
    """Try to verify the theorem for all forcings of a fan; a dict of what came out.

    grids, u, E : of points of the fan; modes and residuals there. sizes, apart : for each degree
    the sizes of the modes of C_jml, and how much T_mT_l moves between these points at most.
    kappa : bounds of |κ_j|. between : (error, rho, norms of the C_jml, j) → a bound of ‖E_j‖ in all
    of the fan from one at the points. Floats choose ρ, ρ̂, the cut and the polynomials near 1/g_j';
    `least` is their estimate of the left side of (1).
    """
    (grid, *_), two_pi = grids, 2 * arb.pi()
    bounds = [[[[x.abs_upper() for x in row] for row in t] for t in rows] for rows in (u, E)]
    largest = [np.array(rows, dtype=float).max(axis=0) for rows in bounds]
    inverses = [
        np.fft.rfft(1 / slopes_on_grid(as_doubles(x, grid.odd), grid.n)) / grid.n for x in u
    ]
    chosen = best_widths(grid, *largest, np.abs(inverses[0]))
    rho, rho_hat = arb(chosen["rho"]), arb(chosen["rho_hat"])
    errors = [
        bounds_of_the_residual(grid, *both, rho, rho_hat, chosen["cut"])
        for grid, *both in zip(grids, *bounds, strict=True)
    ]
    norms = [[norm(row, rho) for row in table] for table in sizes]  # [m][j]
    slopes = [[two_pi * norm([i * x for i, x in enumerate(row)], rho) for row in t] for t in sizes]
    n, p, k, everywhere = [], [], [], []
    for j in range(grid.sites):
        n.append(1 + sum(row[j] for row in slopes))
        k.append((two_pi * (rho + sum(row[j] for row in norms))).exp())
        moved = sum(a * row[j] for a, row in zip(apart, slopes, strict=True))
        of_points = []
        with ctx.workprec(64):
            for modes, near in zip(u, inverses, strict=True):
                slope, d = slope_modes(modes[j], grid.odd), near[j, : chosen["modes"]]
                bound = bound_of_the_inverse(slope, d, rho, grid.odd, chosen["kept"], moved)
                of_points.append(bound)
        p.append(reduce(arb.max, of_points))
        error = reduce(arb.max, [at[j] for at in errors])
        everywhere.append(between(error, rho, [row[j] for row in norms], j))
    eps = sum(a * b for a, b in zip(n, everywhere, strict=True))
    failed, left = inequalities(grid.omega, kappa, rho, eps, n, p, k, part)
    worst = {"error": everywhere, "n": n, "p": p, "k": k}
    left |= {key: reduce(arb.max, of_sites) for key, of_sites in worst.items()}
    # Floats above: the nearest to the upper end of a ball may be below it.
    constants = {key: float(np.nextafter(float(x.upper()), inf)) for key, x in left.items()}
    why = f"not proved: inequalities of the theorem fail: {', '.join(failed)}" if failed else ""
    found = {"proved": not failed, "why": why, "rho": float(rho), "constants": constants}
    return found | {"least": chosen["least"]}


def balls(moves, unit, size, odd):
    """The modes k < size of functions, exact, from whole numbers as of a `BarrierProof`."""
    scale, rows = arb(2) ** unit, []
    for parts in moves:
        if any(parts[1][:1]) or (odd and parts[0]):
            raise ValueError("the modes of a real function are wanted, for two kicks of an odd one")
        re, im = ([*(x * scale for x in part), *[0] * (size - len(part))] for part in parts)
        rows.append([arb(-b) for b in im] if odd else [acb(*x) for x in zip(re, im, strict=True)])
    return rows


# --- what need not be right: choices, and Newton's steps ------------------------------------------


@np.errstate(all="ignore")
def best_widths(grid, u, e, near):
    """ρ, ρ̂ and the cut that look best in floats; `least`: the left side of (1) with them."""
    n, K = grid.n, u.shape[1] - 1
    k, strength = np.arange(n // 2), np.abs(np.array(grid.kappa, dtype=float))[:, None] / (2 * pi)
    hats = decay(u.max(axis=0)) * np.geomspace(0.005, 1.25, 60)
    imaginary = [2 * (u * np.sinh(2 * pi * hat * k[: K + 1])).sum(axis=1) for hat in hats]
    sizes = np.cosh(2 * pi * (hats[:, None] + imaginary)) * np.exp(-pi * n * hats)[:, None]
    best = np.argmin(np.nan_to_num(sizes.max(axis=1), nan=inf))
    hat, M = hats[best], sizes[best][:, None] * np.exp(pi * n * hats[best])
    beyond = (e[:, K + 1 :] > strength * M * np.exp(-2 * pi * hat * k[K + 1 :])).all(axis=0)
    cut = K + 1 + int(beyond.argmax()) if beyond.any() else n // 2
    near = np.where(near < 1e-13 * near.max(), 0, near)  # rounding
    trials = []
    for rho in hat * np.geomspace(0.015, 0.24, 12):
        weights = np.where(k > 0, 2, 1) * np.exp(2 * pi * rho * k)
        errors = e[:, :cut] @ weights[:cut]
        ends = np.exp(2 * pi * cut * (rho - hat)) + np.exp(2 * pi * (cut * (rho + hat) - n * hat))
        errors += (strength * M)[:, 0] * ends / (pi * (hat - rho))
        slopes = 2 * pi * u * k[: K + 1] * weights[: K + 1]
        n_j = 1 + slopes.sum(axis=1)
        inverse = near[:, :-1] * weights
        p = inverse.sum(axis=1)
        size = np.exp(2 * pi * (rho + (u * weights[: K + 1]).sum(axis=1)))
        numbers = [[arb(x) for x in row] for row in (n_j, p, size)]
        eps = arb((n_j * errors).sum())
        _, left = inequalities(grid.omega, grid.kappa, arb(rho), eps, *numbers)
        trials.append(
            {
                "least": np.nan_to_num(float(left["ratio"].mid()), nan=inf),
                "rho": float(rho),
                "rho_hat": float(hat),
                "cut": cut,
                "kept": _part(slopes, 1e-6),
                "modes": _part(inverse, 1e-5),
            }
        )
    return min(trials, key=lambda trial: trial["least"])


def _part(weighted, small):
    """How many leading columns hold all but a small part of the sum of each row."""
    left = np.cumsum(weighted[:, ::-1], axis=1)[:, ::-1] < small * weighted.sum(axis=1)[:, None]
    return int(left.all(axis=0).argmax()) or weighted.shape[1]


def decay(sizes, least=1e-12):
    """ρ with sizes_k ~ e^{-2πρk}, from the modes above `least` of the largest."""
    k = np.arange(len(sizes))
    good = (k > 0) & (sizes > least * sizes[1:].max(initial=0))
    good[: good.sum() // 10] = False
    if good.sum() < 3:
        return 1.0
    return max(-np.polyfit(k[good], np.log(sizes[good]), 1)[0] / (2 * pi), 0.1 / len(k))


@np.errstate(all="ignore")
def refined(grid, start):
    """Newton's steps from `start` until the theorem is verified, or nothing is won by another; a
    dict of what came out."""
    K, turn = int(KEPT * grid.n), turns(grid.omega, grid.sites, grid.n // 2 + 1)
    modes, last, unit = polished(grid.kappa, grid.n, turn, start), inf, -ctx.prec
    if not np.isfinite(modes).all():
        return {"proved": False, "why": "not proved: Newton's method diverges from the start"}
    modes = as_balls(modes, grid.odd)
    for _ in range(_STEPS):
        moves = [whole(row, unit) for row in modes]
        modes = balls(moves, unit, K + 1, grid.odd)
        E, sizes = residual(grid, modes), [[[x.abs_upper() for x in row] for row in modes]]
        found = verified([grid], [modes], [E], sizes, [0], grid.kappa, lambda error, *_: error)
        found |= {"unit": unit, "moves": [[moves]]}
        size = _largest_mode(E, K + 1)
        if found["proved"] or not size < 0.5 * last:
            break
        last, following = size, stepped(grid, turn, modes, E)
        if following is None:
            break
        modes = following
    return found


def _largest_mode(E, K):
    return max(float(x.abs_upper()) for row in E for x in row[:K])


def stepped(grid, turn, modes, E):
    """Newton's step from modes with the residual E; None if it fails."""
    K = len(modes[0])
    scale = arb(_largest_mode(E, K))
    step = correction(turn, as_doubles(modes, grid.odd), as_doubles(E, grid.odd, 1 / scale))
    if not np.isfinite(step).all():
        return None
    return [
        [(a + scale * b).mid() for a, b in zip(row, add, strict=True)]
        for row, add in zip(modes, as_balls(step[:, :K], grid.odd), strict=True)
    ]


def turns(omega, n_sites, n_modes):
    """e^{2πikα}, α = ω/P, in long double, by a convergent of ω; see `circles.fourier.turns`."""
    for f in convergents(omega):
        if f.denominator * n_sites > 10**12:
            break
        p, q = f.numerator, f.denominator * n_sites
    x = (np.arange(n_modes) * (p % q) % q).astype(np.longdouble) / q
    return np.exp(2j * np.arccos(np.longdouble(-1)) * x)


def polished(kappa, n, turn, start):
    """The modes kept on n points of the circle near values on a grid: Newton's steps in long double
    while they help, on the modes above its rounding: beyond them small divisors would make rounding
    larger than u itself."""
    modes = np.zeros((len(kappa), int(KEPT * n) + 1), np.clongdouble)
    given = np.fft.rfft(start)[:, : modes.shape[1]] / start.shape[1]
    modes[:, : given.shape[1]] = (
        given * turn[: given.shape[1]].conj() ** np.arange(len(kappa))[:, None]
    )
    K, last, best = modes.shape[1], inf, modes
    kept = np.arange(K) < _ROUNDED / (2 * pi * decay(np.abs(modes).max(axis=0).astype(float), 1e-6))
    two_pi, rotation = 2 * np.arccos(np.longdouble(-1)), turn[:K]
    strength, theta = np.array(kappa, float)[:, None] / two_pi, np.arange(n) / np.longdouble(n)
    for _ in range(_STEPS):
        x = theta + np.fft.irfft(modes, n) * n
        E = -np.fft.rfft(strength * np.sin(two_pi * x)) / n
        E[:, :K] += np.roll(modes, -1, axis=0) * rotation - 2 * modes
        E[:, :K] += np.roll(modes, 1, axis=0) * rotation.conj()
        size = np.abs(E[:, :K]).max()
        if not size < 0.5 * last:
            break
        best, last = modes, size
        step = correction(turn, modes.astype(complex), (E / size).astype(complex))
        modes = modes + size * step[:, :K] * kept
    return best


def correction(turn, modes, E):
    """Modes of Levi and Moser's step, in doubles, for the modes E of the residual: see circles.

    modes, E : arrays (P, ..., modes); what is between is done at once.
    """
    n, sites = 2 * (turn.size - 1), np.arange(len(modes)).reshape(-1, *[1] * (modes.ndim - 1))
    turn = turn.astype(complex)
    shift = turn**sites  # the step is made in h_j, where θ is the same for all j
    slopes = slopes_on_grid(modes * shift[..., : modes.shape[-1]], n)
    residual = np.fft.irfft(E * shift[..., : E.shape[-1]], n) * n
    whole = turn ** len(modes)
    inverse = 1 / (slopes * np.concatenate([slopes[1:], fourier.rotate(slopes[:1], whole)]))
    flux = -np.cumsum(slopes * residual, axis=0)
    flux = fourier.solve_cohomology(flux[-1], whole, n // 2) + flux
    mean = (flux * inverse).sum((0, -1)) / inverse.sum((0, -1))
    flux = (flux - mean[..., None]) * inverse
    w = fourier.solve_cohomology(flux.sum(axis=0), whole, n // 2)
    w = w + np.cumsum(flux, axis=0) - flux
    w -= (slopes[0] * w[0]).mean(-1)[..., None]
    return np.fft.rfft(slopes * w) / n * shift.conj()


def slopes_on_grid(modes, n):
    """g_j' at φ = i/n."""
    k = np.arange(modes.shape[-1])
    return 1 + np.fft.irfft(2j * pi * k * modes, n) * n


def as_balls(modes, odd):
    """The modes as exact balls, of long doubles in two parts."""

    def exact(x):
        high = x.astype(float)
        low = (x - high).astype(float)
        return [arb(a) + arb(b) for a, b in zip(high.tolist(), low.tolist(), strict=True)]

    if odd:
        return [exact(-row.imag) for row in modes]
    both = [zip(exact(row.real), exact(row.imag), strict=True) for row in modes]
    return [[acb(*pair) for pair in row] for row in both]


def as_doubles(rows, odd, scale=1):
    if odd:
        return -1j * np.array([[float(x * scale) for x in row] for row in rows])
    return np.array([[complex(x * scale) for x in row] for row in rows])


def whole(row, unit):
    """[re, im] of modes in whole numbers, times 2^unit."""
    odd, scale, found = isinstance(row[0], arb), arb(2) ** -unit, []  # odd: they are -ib
    parts = ([], [-x for x in row]) if odd else ([x.real for x in row], [x.imag for x in row])
    for part in parts:
        numbers = [int((x * scale + 0.5).mid().floor().unique_fmpz()) for x in part]
        while numbers and not numbers[-1]:
            numbers.pop()
        found.append(numbers)
    return found


def grid_size(start):
    """Points for the circle's rate of decay: enough on nearly all of the rays that were tried."""
    rate = decay(np.abs(np.fft.rfft(start)).max(axis=0), 1e-6)
    return fast_size(max(64, 2 * ceil(max(5.5, -2.2 * log(rate)) / rate)))


def fast_size(n):
    """The least of 2^k, 5·2^k and 6·2^k from n on: FLINT transforms it twice as fast as others."""
    power = 2 ** (n.bit_length() - 3)
    return power * next(m for m in (4, 5, 6, 8) if m * power >= n)
