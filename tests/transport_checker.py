"""Check a certificate that transport is global, slowly, in ball arithmetic alone.

From the forcing, the boxes and their lives N it verifies the hypothesis of the theorem of
nasm/PROOFS.md, "Transport is global": the boxes cover the starts y of [0, 1/2], and for each box
there is one η, even, with support |k| < N, whose second variation along every orbit of the box is

    Q = Σ_k η_k ((2 + κ_k cos 2πx_k) η_k - η_{k+1} - η_{k-1}) ≤ 0.

Orbits of a box are x_k = x̂_k + σ t_k + σ² q_k + ρ_k, |σ| ≤ 1, as balls of so many digits that
rounding does not matter; nothing here is shared with the package. η is any sequence of floats.
"""

from fractions import Fraction

from flint import arb, ctx, fmpq


class Refuted(Exception):
    """The certificate does not prove what it says."""


def check(certificate):
    """Refuted unless the certificate is right."""
    kappa = [exact(strength) for strength in certificate["kappa"]]
    site, a = certificate["site"], Fraction(certificate["a"])
    demand(len(kappa) == 1 or (len(kappa) == 2 and min(map(abs, kappa)) < 2), "scope")
    demand(site in range(len(kappa)) and a in (0, Fraction(1, 2)), "no symmetry line")
    boxes = [(exact(y), exact(delta)) for y, delta in certificate["boxes"]]
    demand(len(boxes) == len(certificate["lives"]), "not a life for each box")
    reached = Fraction(0)
    for y, delta in sorted(boxes):
        demand(delta > 0 and y - delta <= reached, f"a gap beyond {float(reached)}")
        reached = max(reached, y + delta)
    demand(reached >= Fraction(1, 2), f"a gap beyond {float(reached)}")
    from_line = kappa[site:] + kappa[:site]
    for (y, delta), life in zip(boxes, certificate["lives"], strict=True):
        demand(isinstance(life, int) and life > 0, f"a life of {life!r} kicks")
        bound = second_variation(from_line, a, y, delta, life)
        demand(bound <= 0, f"Q may be {bound} in the box {float(y)} ± {float(delta)}")


def exact(text):
    try:
        return Fraction(*float.fromhex(text).as_integer_ratio())
    except (ValueError, OverflowError):
        raise Refuted(f"{text!r} is no number") from None


def demand(truth, complaint):
    if not truth:
        raise Refuted(complaint)


def ball(fraction):
    return arb(fmpq(fraction.numerator, fraction.denominator))


def second_variation(kappa, a, y, delta, life):
    """An upper bound of Q/2 on the box, a ball, for an η of our choice; κ_0 kicks at x = a."""
    ctx.prec = 128 + 3 * life  # a kick multiplies the radius of a ball by less than 8
    sites = list(orbits(kappa, a, y, delta, life))
    eta = some_sequence(sites)
    middle = linear = quadratic = rest = arb(0)
    for n, (terms, value) in enumerate(zip(sites, eta, strict=True)):
        square = arb(value) ** 2 * (
            fmpq(1, 2) if n == 0 else 1
        )  # the other side has the other half
        after = arb(eta[n + 1]) if n + 1 < len(eta) else arb(0)
        before = after if n == 0 else arb(eta[n - 1])
        neighbours = arb(value) * (after + before) * (fmpq(1, 2) if n == 0 else 1)
        middle += square * (2 + terms[0]) - neighbours
        linear += square * terms[1]
        quadratic += square * terms[2]
        rest += square * terms[3]
    return middle + upper(linear) + positive(quadratic) + rest


def orbits(kappa, a, y, delta, life):
    """For each site the terms of κ cos 2πx(σ) = [0] + σ [1] + σ² [2] ± [3] on the box, balls."""
    pi, delta = arb.pi(), ball(delta)
    strengths = [ball(strength) for strength in kappa]
    x, x_next = ball(a), ball(a + y)
    v, v_next = arb(1), 1 + strengths[0] / 2 * (1 if a == 0 else -1)
    t, t_next = arb(0), delta
    q, q_next = arb(0), arb(0)
    on_v = on_t = arb(0)  # |ρ| ≤ on_v |v| + on_t |t|
    for n in range(life):
        k = strengths[n % len(strengths)]
        sine, cosine = (2 * x).sin_cos_pi()
        # ξ = x - x̂ = σt + σ²q + ρ
        rho = on_v * upper(v) + on_t * upper(t)
        curved = upper(q) + rho  # ≥ |ξ - σt|
        largest = upper(t) + curved
        squares = curved * (largest + upper(t))  # ≥ |ξ² - σ²t²|
        yield (
            k * cosine,
            -2 * pi * k * sine * t,
            -2 * pi * k * (sine * q + pi * cosine * t**2),
            upper(k) * (2 * pi * upper(sine) * rho + 2 * pi**2 * upper(cosine) * squares)
            + upper(k) * 4 * pi**3 / 3 * largest**3,
        )
        # What the next site of the expansion misses, spread over solutions of the linear chain,
        # whose Wronskian v_n t_{n+1} - v_{n+1} t_n is δ.
        defect = upper(k) * (
            pi * upper(sine) * squares
            + 2 * pi**2 / 3 * upper(cosine) * largest**3
            + pi**3 / 3 * largest**4
        )
        on_v += defect * upper(t) / delta
        on_t += defect * upper(v) / delta
        if n == 0:  # the next sites are known: x_1 = a + y, and v is even
            x, x_last, v, v_last, t, t_last, q, q_last = x_next, x, v_next, v, t_next, t, q_next, q
            continue
        slope = 2 + k * cosine
        x, x_last = 2 * x - x_last + k * sine / (2 * pi), x
        q, q_last = slope * q - q_last - pi * k * sine * t**2, q
        t, t_last = slope * t - t_last, t
        v, v_last = slope * v - v_last, v


def some_sequence(sites):
    """Floats η_0 = 1, η_1, …: the even solution of the linear chain in the middle of the box, with
    payments for what Q may be larger by elsewhere; 0 from where it is not positive."""
    eta, paid = [1.0], 0.0
    linear = quadratic = rest = 0.0
    for n, terms in enumerate(sites[:-1]):
        cosine, first, second, bound = (float(term.mid()) for term in terms)
        weight = eta[n] ** 2 * (0.5 if n == 0 else 1)
        linear += weight * first
        quadratic += weight * second
        rest += weight * bound
        due = max(0.0, abs(linear) + max(0.0, quadratic) + rest - paid)
        paid += due
        bend = cosine * eta[n] + due / (weight / eta[n])
        after = eta[0] + bend / 2 if n == 0 else 2 * eta[n] - eta[n - 1] + bend
        if not after > 0:
            break
        eta.append(after)
    return eta + [0.0] * (len(sites) - len(eta))


def upper(number):
    """|number|, from above."""
    return arb(number.abs_upper())


def positive(number):
    """max(0, number), from above."""
    return arb(number.max(arb(0)).upper())
