"""Check a certificate that transport is global, slowly, in ball arithmetic alone.

From the forcing, or a cell of forcings, the boxes and their lives N it verifies the hypothesis of
the theorem of nasm/PROOFS.md, "Transport is global": the boxes cover the starts y of [0, 1/2], and
for each box there is one η, even, with support |k| < N, whose second variation along every orbit of
the box is

    Q = Σ_k η_k ((2 + κ_k cos 2πx_k) η_k - η_{k+1} - η_{k-1}) ≤ 0.

Orbits of a box are x_k = x̂_k + σ t_k + σ_0 p_k + σ_1 p'_k + σ² q_k + ρ_k, |σ|, |σ_i| ≤ 1, as balls
of so many digits that rounding does not matter; p belongs to the strengths κ_i = k_i + σ_i h_i, and
is 0 for a single forcing. Nothing here is shared with the package. η is any sequence of floats.
"""

import hashlib
import json
from fractions import Fraction

from flint import arb, ctx, fmpq


class Refuted(Exception):
    """The certificate does not prove what it says."""


def check(certificate):
    """Refuted unless the certificate is genuine and right."""
    data = {key: value for key, value in certificate.items() if key != "sha256"}
    text = json.dumps(data, sort_keys=True).encode()
    demand(hashlib.sha256(text).hexdigest() == certificate.get("sha256"), "the seal is broken")
    hypothesis(data)


def hypothesis(certificate):
    """Refuted unless the theorem's hypothesis holds; the seal is not looked at."""
    kappa = [exact(strength) for strength in certificate["kappa"]]
    widths = [exact(width) for width in certificate.get("half_width", ["0x0p0"] * len(kappa))]
    site, a, lives = certificate["site"], Fraction(certificate["a"]), certificate["lives"]
    largest = [abs(strength) + width for strength, width in zip(kappa, widths, strict=True)]
    demand(len(kappa) == 1 or (len(kappa) == 2 and min(largest) < 2), "scope")
    demand(site in range(len(kappa)) and a in (0, Fraction(1, 2)), "no symmetry line")
    boxes = [tuple(exact(number) for number in box) for box in certificate["boxes"]]
    demand(len(boxes) == len(lives), "not a life for each box")
    kappa, widths = kappa[site:] + kappa[:site], widths[site:] + widths[:site]
    if "half_width" in certificate:
        covered = [cover_of_piece(group, kappa, widths) for group in pieces(boxes)]
    else:
        covered = [(y - delta, y + delta) for y, delta in boxes]
        strengths = [number for k in kappa for number in (k, Fraction(0))]
        boxes = [(*box, *strengths) for box in boxes]
    reached = Fraction(0)
    for left, right in sorted(covered):
        demand(left < right and left <= reached, f"a gap beyond {float(reached)}")
        reached = max(reached, right)
    demand(reached >= Fraction(1, 2), f"a gap beyond {float(reached)}")
    for box, life in zip(boxes, lives, strict=True):
        demand(isinstance(life, int) and life > 0, f"a life of {life!r} kicks")
        bound = second_variation(a, box, life)
        demand(bound <= 0, f"Q/2 may be {bound} in the box {[float(number) for number in box]}")


def pieces(boxes):
    """The boxes of a cell in groups, by their last number."""
    groups = {}
    for box in boxes:
        groups.setdefault(box[-1], []).append(box)
    return groups.values()


def cover_of_piece(boxes, kappa, widths):
    """The interval of y that boxes with one shear cover for every κ of the cell.

    In u = y - g_0 κ_0 - g_1 κ_1 they are cuboids, which must tile one.
    """
    (shears,) = {box[6:8] for box in boxes}
    cuboids = []
    for y, delta, k0, h0, k1, h1, *_ in boxes:
        demand(min(delta, h0, h1) > 0, "a box without a width")
        u = y - shears[0] * k0 - shears[1] * k1
        cuboids.append(((u - delta, u + delta), (k0 - h0, k0 + h0), (k1 - h1, k1 + h1)))
    left = min(cuboid[0][0] for cuboid in cuboids)
    right = max(cuboid[0][1] for cuboid in cuboids)
    cell = [(k - h, k + h) for k, h in zip(kappa, widths, strict=True)]
    demand(tile(((left, right), *cell), cuboids), "boxes that do not tile their piece of the cell")
    moves = [[shear * end for end in ends] for shear, ends in zip(shears, cell, strict=True)]
    return left + sum(map(max, moves)), right + sum(map(min, moves))


def tile(whole, cuboids):
    """Whether cuboids that were made by halving tile the whole: halve it where none is cut."""
    if len(cuboids) == 1:
        return cuboids[0] == whole
    for axis, (low, high) in enumerate(whole):
        middle = (low + high) / 2
        below = [cuboid for cuboid in cuboids if cuboid[axis][1] <= middle]
        above = [cuboid for cuboid in cuboids if cuboid[axis][0] >= middle]
        if below and above and len(below) + len(above) == len(cuboids):
            halves = ((low, middle), below), ((middle, high), above)
            return all(
                tile((*whole[:axis], ends, *whole[axis + 1 :]), half) for ends, half in halves
            )
    return False


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


def second_variation(a, box, life):
    """An upper bound of Q/2 on the box, a ball, for an η of our choice.

    box : ŷ, δ, then k and h of each strength, the first one that of the kick at x = a, then, if
    there are any, the shears.
    """
    ctx.prec = 128 + 3 * life  # a kick multiplies the radius of a ball by less than 8
    sites = list(orbits(a, box, life))
    eta = some_sequence(sites)
    middle = rest = quadratic = arb(0)
    linear = [arb(0)] * len(sites[0][1])
    for n, (terms, value) in enumerate(zip(sites, eta, strict=True)):
        half = fmpq(1, 2) if n == 0 else 1  # the other half of site 0 is on the other side
        square = arb(value) ** 2 * half
        after = arb(eta[n + 1]) if n + 1 < len(eta) else arb(0)
        before = after if n == 0 else arb(eta[n - 1])
        middle += square * (2 + terms[0]) - arb(value) * (after + before) * half
        linear = [total + square * term for total, term in zip(linear, terms[1], strict=True)]
        quadratic += square * terms[2]
        rest += square * terms[3]
    return middle + sum(map(upper, linear)) + positive(quadratic) + rest


def orbits(a, box, life):
    """For each site balls of κ cos 2πx = [0] + Σ_j σ_j [1]_j + σ² [2] ± [3], on the box."""
    pi = arb.pi()
    y, delta, *strengths = (ball(number) for number in box[:6])
    strengths, widths = strengths[::2], strengths[1::2]
    shears = [ball(number) for number in box[6:8]] or [arb(0)] * len(widths)
    x, x_next = ball(a), ball(a) + y
    v, v_next = arb(1), 1 + strengths[0] / 2 * (1 if a == 0 else -1)
    # By σ, σ_0 and σ_1: by the start, and by the strengths; q is by σ twice.
    moves, moves_next = [arb(0)] * (1 + len(widths)), [delta]
    moves_next += [shear * width for shear, width in zip(shears, widths, strict=True)]
    q, q_next = arb(0), arb(0)
    on_v = on_t = arb(0)  # |ρ| ≤ on_v |v| + on_t |t|
    for n in range(life):
        i = n % len(strengths)
        k, width = strengths[i], widths[i]
        sine, cosine = (2 * x).sin_cos_pi()
        # ξ = x - x̂ = σt + Σ σ_i p_i + σ²q + ρ
        t = moves[0]
        rho = on_v * upper(v) + on_t * upper(t)
        others = sum(map(upper, moves[1:])) + upper(q) + rho  # ≥ |ξ - σt|
        largest = upper(t) + others
        squares = others * (largest + upper(t))  # ≥ |ξ² - σ²t²|
        linear = [-2 * pi * k * sine * move for move in moves]
        linear[1 + i] += width * cosine
        yield (
            k * cosine,
            linear,
            -2 * pi * k * (sine * q + pi * cosine * t**2),
            upper(k) * (2 * pi * upper(sine) * rho + 2 * pi**2 * upper(cosine) * squares)
            + upper(k) * 4 * pi**3 / 3 * largest**3
            + width * 2 * pi * largest * (upper(sine) + pi * largest),  # σ_i h_i (cos - cos)
        )
        # What the next site of the expansion misses, spread over solutions of the linear chain,
        # whose Wronskian v_n t_{n+1} - v_{n+1} t_n is δ.
        defect = upper(k) * (
            pi * upper(sine) * squares
            + 2 * pi**2 / 3 * upper(cosine) * largest**3
            + pi**3 / 3 * largest**4
        )
        defect += width * (upper(cosine) * largest + pi * largest**2)
        on_v += defect * upper(t) / delta
        on_t += defect * upper(v) / delta
        if n == 0:  # the next sites are known: x_1 = a + y, and v is even
            x, x_last, v, v_last, q, q_last = x_next, x, v_next, v, q_next, q
            moves, moves_last = moves_next, moves
            continue
        slope = 2 + k * cosine
        x, x_last = 2 * x - x_last + k * sine / (2 * pi), x
        q, q_last = slope * q - q_last - pi * k * sine * t**2, q
        v, v_last = slope * v - v_last, v
        after = [slope * move - last for move, last in zip(moves, moves_last, strict=True)]
        after[1 + i] += width * sine / (2 * pi)
        moves, moves_last = after, moves


def some_sequence(sites):
    """Floats η_0 = 1, η_1, …: the even solution of the linear chain in the middle of the box, with
    payments for what Q may be larger by elsewhere; 0 from where it is not positive."""
    eta, paid = [1.0], 0.0
    linear, quadratic, rest = [0.0] * len(sites[0][1]), 0.0, 0.0
    for n, terms in enumerate(sites[:-1]):
        cosine, second, bound = (float(terms[i].mid()) for i in (0, 2, 3))
        weight = eta[n] ** 2 * (0.5 if n == 0 else 1)
        linear = [
            total + weight * float(term.mid()) for total, term in zip(linear, terms[1], strict=True)
        ]
        quadratic += weight * second
        rest += weight * bound
        due = max(0.0, sum(map(abs, linear)) + max(0.0, quadratic) + rest - paid)
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
