"""Check a certificate of a barrier: a second program, slow and obvious, without any code of nasm.

A function is a Laurent polynomial in z = e^{2πiφ}, |k| ≤ D, with balls for coefficients, and a
bound of the norm Σ_k |f_k| e^{2π|k|ρ} of all that was left out. Sums, products, rotations and
exponentials are those of the algebra: no grid, no aliases. The theorem is that of nasm/PROOFS.md,
"A barrier exists".
"""

import hashlib
import json
import re

from flint import acb, acb_poly, arb, ctx

BITS = 192


class Function:
    growth, most = None, None  # e^{2πρ}; D

    def __init__(self, coefficients, rest=0):
        """coefficients : list of 2D' + 1 balls; those beyond D go into the rest."""
        middle = len(coefficients) // 2
        beyond = range(self.most + 1, middle + 1)
        for k in beyond:
            rest += (abs(coefficients[middle - k]) + abs(coefficients[middle + k])) * self.growth**k
        cut = len(beyond)
        self.coefficients = coefficients[cut : len(coefficients) - cut]
        self.middle, self.rest = middle - cut, arb(rest)

    def norm(self):
        return self.rest + sum(
            abs(c) * self.growth ** abs(k - self.middle) for k, c in enumerate(self.coefficients)
        )

    def __add__(self, other):
        if self.middle < other.middle:
            self, other = other, self
        total, shift = list(self.coefficients), self.middle - other.middle
        for k, c in enumerate(other.coefficients):
            total[k + shift] += c
        return Function(total, self.rest + other.rest)

    def __mul__(self, other):
        if not isinstance(other, Function):
            return Function([other * c for c in self.coefficients], abs(other) * self.rest)
        product = acb_poly(self.coefficients) * acb_poly(other.coefficients)
        length = len(self.coefficients) + len(other.coefficients) - 1
        rest = self.rest * other.norm() + self.norm() * other.rest
        return Function([product[k] for k in range(length)], rest)

    def __sub__(self, other):
        return self + other * acb(-1)

    def rotated(self, angle):
        """f(φ + angle)."""
        return Function(
            [
                c * acb(2 * angle * (k - self.middle)).exp_pi_i()
                for k, c in enumerate(self.coefficients)
            ],
            self.rest,
        )

    def exp(self, halvings=8, order=20):
        """e^f by Taylor's polynomial of f/2^halvings, squared again and again."""
        small = self * acb(arb(1) / 2**halvings)
        size, power, total, factorial = small.norm(), constant(1), constant(1), 1
        for i in range(1, order + 1):
            factorial *= i
            power = power * small
            total = total + power * acb(arb(1) / factorial)
        total.rest += size ** (order + 1) / (factorial * (order + 1)) * size.exp()
        for _ in range(halvings):
            total = total * total
        return total

    def inverse(self):
        """A bound of ‖1/f‖, f > 0 on the reals: d → d(2 - fd), and then Neumann's series."""
        d = constant(1 / self.norm())
        for _ in range(40):
            defect = constant(1) - self * d
            if defect.norm() < arb(1) / 10**6:
                return d.norm() / (1 - defect.norm())
            d = d * (constant(1) + defect)
            d = Function([c.mid() for c in d.coefficients])
        return arb.pos_inf()


def constant(value):
    return Function([acb(value)])


def quotients(text, length):
    """The first partial quotients of a continued fraction like "[0;2,(1)]"."""
    head, tail = re.fullmatch(r"\[(.*?)\(([\d,]+)\)\]", text).groups()
    head = [int(a) for a in re.split("[;,]", head) if a]
    tail = [int(a) for a in tail.split(",")]
    if min(head[1:] + tail) < 1:
        raise ValueError(text)
    return head + [tail[i % len(tail)] for i in range(length - len(head))], len(head), len(tail)


def rotation(text):
    """ω as a ball, and (q_n, 2|sin πq_nω|) for n = 0, 1, … up to far into the period."""
    _, prefix, period = quotients(text, 0)
    n = prefix + period * (60 // period + 2)
    a, *_ = quotients(text, 2 * n + 100)
    p, q, denominators = (1, 0), (0, 1), []
    for quotient in a:
        p, q = (quotient * p[0] + p[1], p[0]), (quotient * q[0] + q[1], q[0])
        denominators.append(q[0])
    with ctx.workprec(2 * q[0].bit_length() + 64):
        omega = arb(p[0]) / q[0] + arb(0, arb(1) / (q[0] * q[1]))
        divisors = [2 * abs((omega * k).sin_pi()) for k in denominators[:n]]
    return omega, list(zip(denominators, divisors, strict=False)), period


def russmann(divisors, period, delta):
    """sup of δ'e^{-2πqδ'}/divisor over δ' ≤ δ and all denominators q."""
    worst = arb(0)
    for n, (q, divisor) in enumerate(divisors):
        peak = 1 / (2 * arb.pi() * q)
        at = delta if peak > delta and n < len(divisors) - period else peak
        term = at * (-2 * arb.pi() * q * at).exp() / divisor
        if n >= len(divisors) - period:  # these repeat for ever, but for 10^-12
            term = term * (1 + arb(10) ** -9)
        worst = worst.max(term)
    return worst


def dyadic(pair):
    return arb(pair[0]) * arb(2) ** pair[1]


def check(certificate):
    """Whether the certificate is genuine and the theorem applies, and the constants found."""
    data = {key: value for key, value in certificate.items() if key != "sha256"}
    text = json.dumps(data, sort_keys=True).encode()
    if hashlib.sha256(text).hexdigest() != certificate.get("sha256"):
        return False, {}
    with ctx.workprec(BITS):
        return theorem(data)


def theorem(data):
    """Whether the theorem of nasm/PROOFS.md applies, and its constants."""
    two_pi = 2 * arb.pi()
    radius, rho = float.fromhex(data["radius"]), arb(float.fromhex(data["rho"]))
    kappa = [arb(float.fromhex(k), radius) for k in data["kappa"]]
    omega, divisors, period = rotation(data["omega"])
    P = len(kappa)
    if len(data["modes"]) != P or not rho > 0:
        return False, {}
    alpha = omega / P
    Function.growth = (two_pi * rho).exp()
    Function.most = 2 * max(len(row) for row in data["modes"])
    u = []
    for row in data["modes"]:
        half = [acb(dyadic(re), dyadic(im)) for re, im in row]
        half[0] = acb(half[0].real)
        u.append(Function([c.conjugate() for c in half[:0:-1]] + half))
    n, p, k, errors = [], [], [], []
    for j in range(P):
        derivative = [two_pi * acb(0, i - u[j].middle) * c for i, c in enumerate(u[j].coefficients)]
        slope = constant(1) + Function(derivative)
        n.append(slope.norm())
        p.append(slope.inverse())
        k.append((two_pi * (rho + u[j].norm())).exp())
        wave = (u[j] * (two_pi * acb(0, 1))).exp() * Function([acb(0), acb(0), acb(1)])
        back = Function([c.conjugate() for c in wave.coefficients[::-1]], wave.rest)
        sine = (wave - back) * acb(0, -0.5)
        after, before = u[(j + 1) % P].rotated(alpha), u[j - 1].rotated(-alpha)
        error = after + before - u[j] * acb(2) - sine * acb(kappa[j] / two_pi)
        errors.append(error.norm())
    eps = sum(a * b for a, b in zip(n, errors, strict=True)).max(arb(2) ** -1000)
    delta = arb("0.99") * rho / arb("4.2")
    C = russmann(divisors, period, delta) + delta
    holds, left = inequalities(kappa, delta, C, eps, n, p, k)
    found = left | {"delta": delta, "C": C, "epsilon": eps, "error": max_of(errors)}
    found |= {"n": max_of(n), "p": max_of(p), "k": max_of(k)}
    return holds, {name: float(x.upper()) for name, x in found.items()}


def inequalities(kappa, delta, C, eps, n, p, k):
    """Whether (1), (2), (3) hold, and their left sides."""
    P, e, two_pi, eta = len(kappa), arb(1).exp(), 2 * arb.pi(), arb("0.01")
    grown = 1 + eta
    q = [p[j] * p[(j + 1) % P] for j in range(P)]
    w = 2 * C**2 * grown**2 * sum(q)
    x = [two_pi * grown * a * w * eps / delta**2 for a in n]
    ratio = w * eps / (2 * e * delta**3)
    for j in range(P):
        second = k[j] * (arb("0.5") + x[j] / 6) * x[j].exp() * x[j] ** 2
        ratio += n[j] * abs(kappa[j]) / two_pi * grown * second / eps
    chi = 4 * grown * w * eps / (3 * e * arb("0.1") * delta**3)
    room = max_of(q[j] * n[j] * n[(j + 1) % P] * (2 * chi + chi**2) for j in range(P))
    moved = max_of((4 * y / 3).exp() - 1 for y in x)
    holds = eps > 0 and ratio < arb(1) / 32 and chi < eta and room < eta / grown and moved < eta
    return bool(holds), {"ratio": ratio, "chi": chi, "room": room, "moved": moved}


def max_of(balls):
    worst = arb(0)
    for ball in balls:
        worst = worst.max(ball)
    return worst
