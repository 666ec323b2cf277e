"""Check certificates of proofs, slowly and obviously, in ball arithmetic: a second program.

    check(json.loads(text))   # the claim that is thereby proved, or Refuted

It needs python-flint alone, and shares no line with the programs that made the certificates. What
the fields mean, and the statements of the five theorems, is in nasm/proofs/README.md,
"Certificates".

*Transport.* From a forcing, or a cell of forcings, boxes and their lives N it verifies that the
boxes cover the starts of a curve, and that for each box there is one η, of finite support, whose
second variation along every orbit of the box is

    Q = Σ_k η_k ((2 + κ_k cos 2πx_k) η_k - η_{k+1} - η_{k-1}) ≤ 0.

On a symmetry line η is even, and half of Q is summed; on a polygon both halves are, with η = 1 at
the site of the curve, each with its own share of that site. Orbits of a box are

    x_k = x̂_k + Σ_i σ_i ξ_ik + Σ_{i≤j} σ_iσ_j ξ_ijk + ρ_k,   |σ_i| ≤ 1,

where x̂_k, ξ_ik, … are exact numbers of 128 bits, and ρ_k is bounded with all that they miss; one
parameter is that of the start, and two, in a cell, are those of the strengths k + σ_i h. η is any
sequence of floats.

*A barrier*, under one forcing or in a fan. A function is a Laurent polynomial in z = e^{2πiφ},
with balls for coefficients; 1/g_j' is found by sums and products of such. The sine is taken on a
grid, at each of many points of a fan, with a bound of the aliases (`Grid`).

A certificate may be anybody's. `within_limits` refuses what would take too long or too much memory
before anything is computed from it.
"""

import hashlib
import json
import re
import struct
from fractions import Fraction
from functools import reduce
from itertools import combinations_with_replacement

from flint import acb, acb_poly, arb, arb_poly, ctx, fmpq

__all__ = ["Refuted", "check"]

BITS = 192

# What is larger is refused before anything is computed.
KICKS = 64  # of a period
GIVEN_KICKS = 1000  # of a period of the forcing that was shortened
LIFE = 10**5  # kicks of one box: 50 MB of memory
LIVES = 10**7  # kicks of all boxes: a quarter of an hour
QUOTIENTS, DIGITS = 200, 50  # of ω, and of each quotient
DEGREES = 64  # in s, and in t
UNIT = 10**4  # of 2^unit, either sign; and bits of the whole number of a mode
_LOST = 1000  # turns between orbits of a box: bounds beyond grow like 4 to the power of 4^n
MODES = 3 * 10**7  # modes of the longest function, times points of the fan, times kicks: an hour

_TRANSPORT = {"kappa", "site", "boxes", "lives"}
_BARRIER = {"kappa", "omega", "rho", "shortened_from", "moves"}
# Of each theorem: the digest of its statement; the fields besides `claim`, `theorem` and the seal.
THEOREMS = {
    "Transport is global": (
        "262141d95693b0b62f3f795cda61e9e083a5385af394d67e85edbe1571432456",
        _TRANSPORT | {"a", "shortened_from"},
    ),
    "Transport is global under several kicks": (
        "c1fbdccdea0195bf4b321a527d9b0984f55a0f1bf7a78dba1f59f19aa76e3e01",
        _TRANSPORT | {"points", "shortened_from"},
    ),
    "Transport is global in a cell": (
        "252fcfc01d65f0889b4a0b174de5a6003b903e8f7f0525d1c64b8a26d954ebb8",
        _TRANSPORT | {"a", "half_width"},
    ),
    "A barrier exists": (
        "39e7a1e397c5a92e49d751f8f00d1d304498a8c6402f591b2eea56ea3c2a93c2",
        _BARRIER,
    ),
    "A barrier exists in a fan": (
        "6005a30ef68f1016cd6eb6f93af43ac9da23d17acad3487e6d00bf2b294f0fc2",
        _BARRIER | {"tilt", "scales"},
    ),
}


class Refuted(Exception):
    """The certificate does not prove what it says."""


def check(certificate, most_kicks=LIVES):
    """The claim, which is proved, of a certificate that is genuine and right; Refuted otherwise.

    most_kicks : of all boxes of a proof of transport together; more are refused unread. They take
    about 7·10⁻⁵ s each.
    """
    try:
        return _checked(certificate, most_kicks)
    except (
        ArithmeticError,
        AttributeError,
        LookupError,
        RecursionError,
        TypeError,
        ValueError,
        struct.error,
    ) as error:
        raise Refuted(f"malformed: {type(error).__name__}: {error}") from None


def _checked(certificate, most_kicks):
    data = {key: value for key, value in certificate.items() if key != "sha256"}
    text = json.dumps(data, sort_keys=True).encode()
    demand(hashlib.sha256(text).hexdigest() == certificate.get("sha256"), "the seal is broken")
    name = data["theorem"]["name"]
    digest, fields = THEOREMS[name]
    demand(data["theorem"] == {"name": name, "version": 1, "sha256": digest}, "another statement")
    demand(type(data["theorem"]["version"]) is int, "another statement")
    demand(data.keys() == {"claim", "theorem", *fields}, "fields are missing, or unknown")
    within_limits(data, most_kicks)
    demand(data["claim"] == claim(data), f"what is claimed is not {claim(data)!r}")
    if "shortened_from" in data:
        shortened(data)
    if "points" in data:
        hypothesis_of_several(data)
    elif "boxes" in data:
        hypothesis(data)
    else:
        with ctx.workprec(BITS):
            holds, found = theorem(data)
        demand(holds, f"an inequality of the theorem fails: {found}")
    return data["claim"]


def within_limits(data, most_kicks):
    """Refuted unless all fields are of their kind, and none is too large to be checked."""
    given = data.get("shortened_from", {})
    demand(type(given) is dict, "shortened_from is no object")
    demand(is_row(data["kappa"], KICKS), f"kappa is no list of 1 to {KICKS} numbers")
    if given:
        words = f"the given forcing is no list of 1 to {GIVEN_KICKS} numbers"
        demand(is_row(given["kappa"], GIVEN_KICKS), words)
    for field in {"half_width", "tilt"} & data.keys():
        words = f"{field} has not a number for each kick"
        demand(is_row(data[field], KICKS) and len(data[field]) == len(data["kappa"]), words)
    if "boxes" in data:
        within_limits_of_boxes(data, most_kicks)
    else:
        for omega in (data["omega"], given["omega"]):
            quotients(omega)
        within_limits_of_moves(data)


def within_limits_of_boxes(data, most_kicks):
    boxes, lives = data["boxes"], data["lives"]
    several = "points" in data
    demand(type(lives) is list and lives, "lives are no list")
    demand(is_whole(data["site"]), "site is no whole number")
    if several:
        words = "lives are not in pairs, forwards and backwards"
        demand(all(type(pair) is list and len(pair) == 2 for pair in lives), words)
    kicks = [life for pair in lives for life in pair] if several else lives
    words = f"lives are not whole numbers from 1 to {LIFE}"
    demand(all(is_whole(life) and 1 <= life <= LIFE for life in kicks), words)
    demand(sum(kicks) <= most_kicks, f"boxes live for more than {most_kicks} kicks in all")
    columns = 3 if several else 9 if "half_width" in data else 2
    words = f"boxes are not {columns} texts of 16 digits for each life"
    demand(type(boxes) is list and len(boxes) == columns, words)
    demand(all(type(column) is str and len(column) == 16 * len(lives) for column in boxes), words)
    if several:
        points = data["points"]
        words = "points are not 2 or more pairs, or are more than the boxes can join"
        demand(type(points) is list and 2 <= len(points) <= len(lives) + 1, words)
        demand(all(is_row(point, 2) and len(point) == 2 for point in points), words)
    else:
        demand(type(data["a"]) in (int, float), "a is no number")


def within_limits_of_moves(data):
    demand(0 < exact(data["rho"]) <= 1, "rho is not from 0 to 1")
    if "scales" in data:
        demand(is_row(data["scales"], 2) and len(data["scales"]) == 2, "scales are not 2 numbers")
    demand(data["moves"].keys() == {"unit", "numbers"}, "moves are not a unit and numbers")
    unit, numbers = data["moves"]["unit"], data["moves"]["numbers"]
    words = f"the unit is no whole number from -{UNIT} to {UNIT}"
    demand(is_whole(unit) and abs(unit) <= UNIT, words)
    for rows in (numbers, *numbers):
        words = f"functions are not of 1 to {DEGREES} degrees in s, and in t"
        demand(type(rows) is list and 1 <= len(rows) <= DEGREES, words)
    longest = 0
    for functions in (functions for rows in numbers for functions in rows):
        words = "not a function for a kick"
        demand(type(functions) is list and len(functions) == len(data["kappa"]), words)
        words = f"a function is not two lists of whole numbers of {UNIT} bits"
        for parts in functions:
            demand(type(parts) is list and len(parts) == 2, words)
            for part in parts:
                demand(type(part) is list, words)
                demand(all(is_whole(x) and x.bit_length() <= UNIT for x in part), words)
                longest = max(longest, len(part))
    points = (len(numbers) + 1) * (max(map(len, numbers)) + 1)
    demand(longest * points * len(data["kappa"]) <= MODES, "modes are too many for their points")


def is_whole(x):
    """Whether it is an int; bools and floats that equal one are not."""
    return type(x) is int


def is_row(texts, most):
    """Whether it is a list of 1 to `most` numbers, each a text as `float.hex` writes it."""
    return type(texts) is list and 1 <= len(texts) <= most and all(map(is_number, texts))


def is_number(text):
    return exact(text) is not None


def claim(data):
    """What the certificate may claim, in the words of README.md, of the forcing as it was given."""
    given = data.get("shortened_from", data)
    under = f"the forcing {spelled(given['kappa'])}"
    if "half_width" in data:
        under = f"every forcing within {spelled(data['half_width'])} of {spelled(given['kappa'])}"
    elif "scales" in data:
        low, high = (repr(float.fromhex(number)) for number in data["scales"])
        along = spelled(given["kappa"])
        if any(map(exact, data["tilt"])):
            along = f"({along} + t {spelled(data['tilt'])}), -1 <= t <= 1"
        under = f"every forcing from {low} to {high} times {along}"
    if "omega" in given:
        return f"a rotational invariant circle of {given['omega']} exists under {under}"
    return f"transport is global under {under}"


def spelled(numbers):
    return f"({', '.join(repr(float.fromhex(number)) for number in numbers)})"


def shortened(data):
    """Refuted unless the forcing, and ω, are those given, or the same map's with fewer kicks.

    Either κ repeats itself; or only every m-th site is kicked, and it does with every second of
    these signs turned, as x moves on by 1/2 more from one of these sites to the next.
    """
    given = data["shortened_from"]
    long, short = ([exact(k) for k in strengths] for strengths in (given["kappa"], data["kappa"]))
    n_long, n_short = len(long), len(short)
    demand(n_short > 0 and n_long % n_short == 0, "a forcing that is not shortened to a part")
    demand(given.keys() == {"kappa", "omega"} & data.keys(), "fields of shortened_from")
    repeated = short * (n_long // n_short)
    turns = [Fraction(0)] if long == repeated else []  # of a period, beyond ω
    for spacing in (m for m in range(1, n_long // 2 + 1) if n_long % (2 * m) == 0):
        for first in range(spacing):
            signs = [0] * n_long
            signs[first :: 2 * spacing] = [1] * (n_long // (2 * spacing))
            signs[first + spacing :: 2 * spacing] = [-1] * (n_long // (2 * spacing))
            pairs = zip(signs, long, repeated, strict=True)
            if all(k == sign * kept and (sign or not kept) for sign, k, kept in pairs):
                turns.append(Fraction(n_long, 2 * spacing))
    demand(turns, "the forcing is not the given one, shortened")
    if "omega" in data:
        if any(map(exact, data.get("tilt", []))):
            demand(long == short, "forcings in several directions are not shortened")
            turns = [Fraction(0)]  # the others have not the symmetry of κ
        (a, b), (a_short, b_short) = surd(given["omega"]), surd(data["omega"])
        times = Fraction(n_long, n_short)
        same = [((a_short * times - a - turn) / n_long).denominator == 1 for turn in turns]
        demand(b_short * times**2 == b and any(same), "omega is not the given one, shortened")


def surd(text):
    """(a, ±b²) of ω = a ± b, b the root of a fraction."""
    head, tail = quotients(text)
    (p, p_last), (q, q_last) = product(tail)  # x = (p x + p')/(q x + q') = (r + √d)/t
    r, t, d = p - q_last, 2 * q, (q_last - p) ** 2 + 4 * q * p_last
    (p, p_last), (q, q_last) = product(head)
    a, b, above, below = p * r + p_last * t, p, q * r + q_last * t, q
    norm = above**2 - d * below**2
    root = Fraction(b * above - a * below, norm)
    return Fraction(a * above - d * b * below, norm), root * abs(root) * d


def product(quotients):
    p, q = (1, 0), (0, 1)
    for a in quotients:
        p, q = (a * p[0] + p[1], p[0]), (a * q[0] + q[1], q[0])
    return p, q


def exact(text):
    """The number that a text is, as `float.hex` writes it: "0.5" would be read as 5/16."""
    demand(type(text) is str and len(text) <= 24, "a number that is no text of at most 24 letters")
    try:
        number = float.fromhex(text)
        demand(number.hex() == text, f"{text!r} is not as float.hex writes it")
        return Fraction(*number.as_integer_ratio())
    except (ValueError, OverflowError):
        raise Refuted(f"{text!r} is no number") from None


def rows(columns):
    """Rows of exact numbers from the texts of their columns, of 16 hexadecimal digits a number."""
    columns = [bytes.fromhex(column) for column in columns]
    columns = [map(Fraction, struct.unpack(f">{len(data) // 8}d", data)) for data in columns]
    return list(zip(*columns, strict=True))


def demand(truth, complaint):
    if not truth:
        raise Refuted(complaint)


# --- transport is global --------------------------------------------------------------------------


def hypothesis(certificate):
    """Refuted unless the hypothesis of transport's theorem holds, for a forcing or a cell."""
    kappa = [exact(strength) for strength in certificate["kappa"]]
    widths = [exact(width) for width in certificate.get("half_width", [(0.0).hex()] * len(kappa))]
    site, a, lives = certificate["site"], Fraction(certificate["a"]), certificate["lives"]
    largest = [abs(strength) + width for strength, width in zip(kappa, widths, strict=True)]
    demand(len(kappa) == 1 or (len(kappa) == 2 and min(largest) < 2), "scope")
    demand(site in range(len(kappa)) and a in (0, Fraction(1, 2)), "no symmetry line")
    boxes = rows(certificate["boxes"])
    demand(len(boxes) == len(lives), "not a life for each box")
    kappa, widths = kappa[site:] + kappa[:site], widths[site:] + widths[:site]
    if "half_width" in certificate:
        pieces = {}
        for box in boxes:
            pieces.setdefault(box[-1], []).append(box)
        covered = [cover_of_piece(group, kappa, widths) for group in pieces.values()]
    else:
        covered = [(y - delta, y + delta) for y, delta in boxes]
        strengths = [number for k in kappa for number in (k, Fraction(0))]
        boxes = [(*box, *strengths) for box in boxes]
    cover(covered, Fraction(1, 2))
    for box, life in zip(boxes, lives, strict=True):
        demand(isinstance(life, int) and life > 0, f"a life of {life!r} kicks")
        bound = second_variation(a, box, life)
        demand(bound <= 0, f"Q/2 may be {bound} in the box {[float(number) for number in box]}")


def cover(intervals, end):
    """Refuted unless the intervals cover [0, end]."""
    reached = Fraction(0)
    for left, right in sorted(intervals):
        demand(left < right and left <= reached, f"a gap beyond {float(reached)}")
        reached = max(reached, right)
    demand(reached >= end, f"a gap beyond {float(reached)}")


def hypothesis_of_several(certificate):
    """Refuted unless the hypothesis of the theorem for several kicks holds."""
    kappa = [exact(strength) for strength in certificate["kappa"]]
    demand(any(is_positive(kappa[m + 1 :] + kappa[:m]) for m in range(len(kappa))), "scope")
    points = [tuple(exact(number) for number in point) for point in certificate["points"]]
    ends = {(2 * x).denominator * (2 * y).denominator for x, y in (points[0], points[-1])}
    demand(ends == {1} and points[0][1] != points[-1][1], "a curve that its images do not continue")
    boxes = rows(certificate["boxes"])
    lives, site = certificate["lives"], certificate["site"]
    demand(site in range(len(kappa)) and len(boxes) == len(lives), "site, or lives")
    cover([(s - delta, s + delta) for s, delta, _ in boxes], Fraction(len(points) - 1, 2))
    ahead = kappa[site:] + kappa[:site]
    for (s, delta, split), life in zip(boxes, lives, strict=True):
        piece = int(2 * (s - delta))
        demand(2 * (s + delta) <= piece + 1, "a box across a corner")
        demand(Fraction(float(1 - split)) == 1 - split, "a share of the site that is no float")
        (x, y), (x_end, y_end) = points[piece : piece + 2]
        middle = [
            start + (2 * s - piece) * (end - start) for start, end in ((x, x_end), (y, y_end))
        ]
        width = 2 * delta * (x_end - x), 2 * delta * (y_end - y)
        begun = halves(*middle, *width, split)
        for half, kicks, n in zip(begun, (ahead, ahead[::-1]), life, strict=True):
            demand(isinstance(n, int) and n > 0, f"a life of {n!r} kicks")
            with ctx.workprec(128):
                eta, *orbit = [[ball(number) for number in pair] for pair in half]
                strengths = [(ball(k), arb(0)) for k in kicks]
                sites = list(orbits(orbit, strengths, [], n))
                bound = summed(sites, eta[0], float(half[0][1]))
            demand(bound <= 0, f"half of Q may be {bound} in the box at {float(s)}")


def is_positive(kappa):
    """Whether the matrix with 2 - |κ_j| on the diagonal and -1 beside it is positive definite."""
    pivot = None
    for k in kappa:
        pivot = 2 - abs(k) - (1 / pivot if pivot else 0)
        if pivot <= 0:
            return False
    return True


def halves(x, y, x_width, y_width, split):
    """Of the half of Q from the curve's site on, and of that from the site before on, where
    x_{c-n} → -x_{c-n}: η, x, v and t, each of the site in front and of the first site.

    The curve's site counts ahead as if η before it were 1 - split; behind, η is that there.
    """
    # Any slope of v will do that makes it no multiple of t: `split`, if it is none nearly.
    near = abs(y_width - split * x_width) < (abs(x_width) + abs(y_width)) / 10_000
    slope = split + near
    ahead = (1 - split, 1), (x - y, x), (1 - slope, 1), (x_width - y_width, x_width)
    behind = (1, 1 - split), (-x, y - x), (1, 1 - slope), (-x_width, y_width - x_width)
    return ahead, behind


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
            parts = ((low, middle), below), ((middle, high), above)
            return all(
                tile((*whole[:axis], ends, *whole[axis + 1 :]), part) for ends, part in parts
            )
    return False


def ball(fraction):
    return arb(fmpq(fraction.numerator, fraction.denominator))


def second_variation(a, box, life):
    """An upper bound of Q/2 on the box of a symmetry line, a ball, for an even η of our choice.

    box : ŷ, δ, then k and h of each strength, the first one that of the kick at x = a, then, if
    there are any, the shears.
    """
    with ctx.workprec(128):
        begun, eta = on_a_line(a, box)
        return summed(list(orbits(*begun, life)), *eta)


def on_a_line(a, box):
    """The arguments of `orbits`, and of `summed`, for such a box."""
    y, delta, *strengths = (ball(number) for number in box[:6])
    strengths = list(zip(strengths[::2], strengths[1::2], strict=True))
    shears = [ball(number) for number in box[6:8]] or [arb(0)] * len(strengths)
    aside = [shear * width for shear, (_, width) in zip(shears, strengths, strict=True)]
    before = 1 + strengths[0][0] / 2 * (1 if a == 0 else -1)  # as behind the site
    begun = (ball(a) - y, ball(a)), (before, arb(1)), (-delta, arb(0))
    return (begun, strengths, aside), (before, 1.0, fmpq(1, 2))


def summed(sites, before, first, share=1):
    """An upper bound of the sum over what `orbits` yields, for an η of our choice.

    before, first : η in front of the first site, and there. share : of the first site; with 1/2, η
    is even about it, and what is in front of it is what is behind it.
    """
    eta = some_sequence(sites, before, first, share)
    middle = rest = arb(0)
    signed, squares = ([arb(0)] * len(terms) for terms in sites[0][1:3])
    for n, (terms, value) in enumerate(zip(sites, eta, strict=True)):
        half = share if n == 0 else 1  # the other half of the first site is on the other side
        square = arb(value) ** 2 * half
        after = arb(eta[n + 1]) if n + 1 < len(eta) else arb(0)
        if n > 0:
            before = arb(eta[n - 1])
        elif share != 1:
            before = after
        middle += square * (2 + terms[0]) - arb(value) * (after + before) * half
        signed = [total + square * term for total, term in zip(signed, terms[1], strict=True)]
        squares = [total + square * term for total, term in zip(squares, terms[2], strict=True)]
        rest += square * terms[3]
    return middle + sum(map(upper, signed)) + sum(map(positive, squares)) + rest


def orbits(begun, strengths, aside, life):
    """For each site balls of κ cos 2πx = [0] + Σ f_i [1]_i + Σ σ_i² [2]_i ± [3], on the box.

    f_i are the parameters σ_i, and then the products of two different ones.

    begun : x, v and t, each in front of the first site and there. strengths : k and h of each kick,
    the first one that of the first site. aside : how far x of the second site moves with each
    strength, [] if all h are 0.
    """
    pi = arb.pi()
    (x_last, x), (v_last, v), (t_last, t) = begun
    # By the parameters: the start's, and those of the strengths; and by products of two of them.
    moves_last, moves = [t_last, *(-move for move in aside)], [t] + [arb(0)] * len(aside)
    pairs = list(combinations_with_replacement(range(len(moves)), 2))
    bends_last = bends = [arb(0)] * len(pairs)
    on_v = on_t = arb(0)  # |ρ| ≤ on_v |v| + on_t |t|
    for n in range(life):
        i = n % len(strengths)
        k, width = strengths[i]
        sine, cosine = (2 * x).sin_cos_pi()
        # x - x̂ = ξ + Σ σ_iσ_j bends_ij + ρ, ξ = Σ σ_i moves_i
        t = moves[0]
        rho = on_v * upper(v) + on_t * upper(t)
        curved = sum(map(upper, bends)) + rho
        straight = sum(map(upper, moves))
        largest = straight + curved
        demand(largest < _LOST, f"after {n} kicks orbits of a box are lost")
        squares = curved * (largest + straight)  # ≥ |(x - x̂)² - ξ²|
        products = [moves[a] * moves[b] * (1 if a == b else 2) for a, b in pairs]
        # σ_i of this kick's strength, times ξ.
        mixed = [moves[a + b - 1 - i] if aside and 1 + i in (a, b) else arb(0) for a, b in pairs]
        linear = [-2 * pi * k * sine * move for move in moves]
        if aside:
            linear[1 + i] += width * cosine
        quadratic = [
            -2 * pi * (k * (sine * bend + pi * cosine * product) + width * sine * other)
            for bend, product, other in zip(bends, products, mixed, strict=True)
        ]
        crossed = [term for term, (a, b) in zip(quadratic, pairs, strict=True) if a != b]
        yield (
            k * cosine,
            linear + crossed,
            [term for term, (a, b) in zip(quadratic, pairs, strict=True) if a == b],
            upper(k) * (2 * pi * upper(sine) * rho + 2 * pi**2 * upper(cosine) * squares)
            + upper(k) * 4 * pi**3 / 3 * largest**3
            # σ_i h_i (cos - cos), beyond σ_i h_i ξ
            + width * 2 * pi * (upper(sine) * curved + pi * largest**2),
        )
        # What the next site of the expansion misses is spread over v and t, which also miss a
        # little; by Cramer's rule, with their Wronskian v_n t_{n+1} - v_{n+1} t_n.
        defect = upper(k) * (
            pi * upper(sine) * squares
            + 2 * pi**2 / 3 * upper(cosine) * largest**3
            + pi**3 / 3 * largest**4
        )
        defect += width * (
            upper(cosine) * curved
            + pi * upper(sine) * largest**2
            + 2 * pi**2 / 3 * largest**3
            + pi**3 / 3 * largest**4
        )
        slope = 2 + k * cosine
        x_next = 2 * x - x_last + k * sine / (2 * pi)
        v_next = slope * v - v_last
        moves_next = [slope * move - last for move, last in zip(moves, moves_last, strict=True)]
        if aside:
            moves_next[1 + i] += width * sine / (2 * pi)
        bends_next = [
            slope * bend - last - pi * k * sine * product + width * cosine * other
            for bend, last, product, other in zip(bends, bends_last, products, mixed, strict=True)
        ]
        # Exact numbers take their place, so that balls do not grow: that is one more miss.
        x_next, missed = x_next.mid(), upper(x_next - x_next.mid())
        defect += missed + on_v * upper(v_next - v_next.mid())
        defect += sum(upper(move - move.mid()) for move in moves_next + bends_next)
        defect += on_t * upper(moves_next[0] - moves_next[0].mid())
        v_next, moves_next = v_next.mid(), [move.mid() for move in moves_next]
        wronskian = arb((v * moves_next[0] - v_next * t).abs_lower())
        on_v += defect * upper(t) / wronskian
        on_t += defect * upper(v) / wronskian
        x, x_last, v, v_last = x_next, x, v_next, v
        moves, moves_last = moves_next, moves
        bends, bends_last = [bend.mid() for bend in bends_next], bends


def some_sequence(sites, before, first, share=1):
    """Floats η: the solution of the linear chain in the middle of the box, with payments for what Q
    may be larger by elsewhere; 0 from where it is not positive. As `summed`."""
    eta, last, paid = [first], float(arb(before).mid()), 0.0
    signed, squares = ([0.0] * len(terms) for terms in sites[0][1:3])
    rest = 0.0
    for n, terms in enumerate(sites[:-1]):
        cosine, bound = (float(terms[i].mid()) for i in (0, 3))
        weight = eta[n] ** 2 * (float(share) if n == 0 else 1)
        signed, squares = (
            [total + weight * float(term.mid()) for total, term in zip(totals, parts, strict=True)]
            for totals, parts in ((signed, terms[1]), (squares, terms[2]))
        )
        rest += weight * bound
        due = max(0.0, sum(map(abs, signed)) + sum(max(0.0, x) for x in squares) + rest - paid)
        paid += due
        after = 2 * eta[n] - last + cosine * eta[n] + due / eta[n]
        if not after > 0:
            break
        last = eta[n]
        eta.append(after)
    return eta + [0.0] * (len(sites) - len(eta))


def upper(number):
    """|number|, from above."""
    return arb(number.abs_upper())


def positive(number):
    """max(0, number), from above."""
    return arb(number.max(arb(0)).upper())


# --- a barrier exists -----------------------------------------------------------------------------


def norm(modes, r):
    """Σ_k |f_k| r^|k|, of the modes -K, …, K."""
    middle = len(modes) // 2
    up, down = (sizes(half)(r) for half in (modes[middle:], modes[middle::-1]))
    return up + down - abs(modes[middle])


def multiplied(f, g):
    both = acb_poly(f) * acb_poly(g)
    return [both[k] for k in range(len(f) + len(g) - 1)]


def inverse(f, r, most):
    """Modes |k| ≤ most of d near 1/f, f > 0 on the reals, by d → d(2 - fd); and ‖1 - fd‖."""
    after = [1 / norm(f, r)]
    for _ in range(41):
        d, defect = after, [-x for x in multiplied(f, after)]
        defect[len(defect) // 2] += 1
        size = norm(defect, r)
        if size < arb(1) / 10**6:
            break
        defect[len(defect) // 2] += 1
        after = [x.mid() for x in inner(multiplied(d, inner(defect, most)), most)]
    return d, size


def inner(modes, most):
    beyond = max(0, len(modes) // 2 - most)
    return modes[beyond : len(modes) - beyond]


def neumann(size, defect):
    """A bound of ‖1/f‖ from ‖d‖ and ‖1 - fd‖."""
    return size / (1 - defect) if defect < 1 else arb.pos_inf()


def quotients(text):
    """The partial quotients of a text like "[0;2,(1)]": those before the period, and one period."""
    most = QUOTIENTS * (DIGITS + 1)
    demand(type(text) is str and len(text) <= most, f"omega is no text of at most {most} letters")
    match = re.fullmatch(r"\[((?:-?\d+;)?(?:\d+,)*)\(((?:\d+,)*\d+)\)\]", text, re.ASCII)
    demand(match, f"{text[:40]!r} is no quadratic irrational")
    parts = [re.findall(r"-?\d+", part) for part in match.groups()]
    words = f"omega has not 1 to {QUOTIENTS} partial quotients of at most {DIGITS} digits"
    demand(sum(map(len, parts)) <= QUOTIENTS, words)
    demand(all(len(a.lstrip("-")) <= DIGITS for part in parts for a in part), words)
    head, tail = ([int(a) for a in part] for part in parts)
    demand(min(head[1:] + tail) >= 1, f"{text[:40]!r} has a partial quotient below 1")
    return head, tail


def rotation(text):
    """ω as a ball, and (q_n, 2|sin πq_nω|) for n = 0, 1, … up to far into the period."""
    head, tail = quotients(text)
    period = len(tail)
    n = len(head) + period * (60 // period + 2)
    p, q, denominators = (1, 0), (0, 1), []
    for quotient in head + [tail[i % period] for i in range(2 * n + 100 - len(head))]:
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


def conclusion(kappa, rho, divisors, period, errors, n, p, k):
    """Whether the inequalities of the theorem hold, and all of its constants."""
    eps = sum(a * b for a, b in zip(n, errors, strict=True)).max(arb(2) ** -1000)
    delta = arb("0.99") * rho / arb("4.2")
    C = russmann(divisors, period, delta) + delta
    holds, left = inequalities(kappa, delta, C, eps, n, p, k)
    found = left | {"delta": delta, "C": C, "epsilon": eps, "error": reduce(arb.max, errors)}
    found |= {"n": reduce(arb.max, n), "p": reduce(arb.max, p), "k": reduce(arb.max, k)}
    return holds, {name: float(x.upper()) for name, x in found.items()}


def inequalities(kappa, delta, C, eps, n, p, k):
    """Whether (1), (2), (3) hold, and their left sides; and the largest |κ_j|."""
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
    room = reduce(arb.max, [q[j] * n[j] * n[(j + 1) % P] * (2 * chi + chi**2) for j in range(P)])
    moved = reduce(arb.max, [(4 * y / 3).exp() - 1 for y in x])
    holds = eps > 0 and ratio < arb(1) / 32 and chi < eta and room < eta / grown and moved < eta
    largest = reduce(arb.max, map(abs, kappa))
    left = {"ratio": ratio, "chi": chi, "room": room, "moved": moved}
    return bool(holds), left | {"kappa": largest}


def theorem(data):
    """Whether the theorem applies to the forcing, or to every one of the fan, and its constants.

    u_j = Σ_ml C_jml T_m(σ) T_l(t); a polynomial of the modes k ≥ 0 stands for a real function of φ.
    """
    rho, (omega, divisors, period) = arb(float.fromhex(data["rho"])), rotation(data["omega"])
    single = {"tilt": [(0.0).hex()] * len(data["kappa"]), "scales": [(1.0).hex()] * 2}
    kappa, tilt, (low, high) = (
        [exact(x) for x in (single | data)[key]] for key in ("kappa", "tilt", "scales")
    )
    long, fanned = "scales" in data, any(tilt)
    demand(0 <= low < high or not long, "no part of a fan")
    demand(rho > 0 and 0 < len(kappa) == len(tilt), "no part of a fan")
    numbers, unit = data["moves"]["numbers"], arb(2) ** data["moves"]["unit"]
    widest = max(map(len, numbers))
    demand(long or len(numbers) == 1, "functions of s under one forcing")
    demand(fanned or widest == 1, "functions of t on a ray")
    demand(all(len(f) == len(kappa) for rows in numbers for f in rows), "not a function for a kick")
    moves = {
        (m, i): [half_modes(*row, unit) for row in functions]
        for m, rows in enumerate(numbers)
        for i, functions in enumerate(rows)
    }
    kappa, tilt = ([ball(x) for x in row] for row in (kappa, tilt))
    middle, half, high = ball((low + high) / 2), ball((high - low) / 2), ball(high)

    def strengths(s, t):
        return [s * (a + t * b) for a, b in zip(kappa, tilt, strict=True)]

    bounds = {m: [sizes(f) for f in row] for m, row in moves.items()}
    totals = [sum(column, arb_poly()) for column in zip(*bounds.values(), strict=True)]
    r, two_pi = (2 * arb.pi() * rho).exp(), 2 * arb.pi()
    slopes = {m: [2 * two_pi * r * f.derivative()(r) for f in row] for m, row in bounds.items()}
    n = [1 + sum(column) for column in zip(*slopes.values(), strict=True)]
    k = [(two_pi * (rho + real_norm(f, r))).exp() for f in totals]
    p, errors, grid = [arb(0)] * len(n), [arb(0)] * len(n), Grid(rho, totals)
    # One point more than degrees, where anything depends on s, or on t.
    points = len(numbers) + 1 if long else 1, widest + 1 if fanned else 1
    for angle, beside, u in at_points(moves, points):
        there = strengths(middle + half * angle.cos_pi(), beside.cos_pi())
        found = grid.residuals(there, u, omega / len(kappa))
        errors = [old.max(new) for old, new in zip(errors, found, strict=True)]
    # Between these points an angle differs by π/2few or less, and T_m by 2 sin(mπ/4few).
    demand(all(error < 1 for error in errors), "a residual that is not even below 1")
    few = 12 if long else 1, 8 if fanned else 1
    step = [[2 * (arb(min(m, 2 * f)) / (4 * f)).sin_pi() for m in range(sum(points))] for f in few]
    for *_, u in at_points(moves, few):
        for j, f in enumerate(u):
            terms = ((step[0][m] + step[1][i]) * row[j] for (m, i), row in slopes.items())
            moved = sum(terms, arb(0))
            with ctx.workprec(64):
                d, defect = inverse(slope(f), r, 2 * max(map(len, totals)))
                p[j] = p[j].max(neumann(norm(d, r), defect + moved * norm(d, r)))
    constants = [lebesgue(N) for N in points]
    largest = [abs(a) + abs(b) for a, b in zip(kappa, tilt, strict=True)]
    for j in range(len(n)):
        missed = [arb.pos_inf() if varies else arb(0) for varies in (long, fanned)]
        for far in [arb(i) / 10 for i in range(1, 40)]:  # log r of the ellipse in σ, or in t
            out = far.cosh()
            reach = (middle + half * out) * largest[j], high * (abs(kappa[j]) + abs(tilt[j]) * out)
            for axis in (0, 1):
                grown = ((m[axis] * far).cosh() * 2 * row[j](r) for m, row in bounds.items())
                B = reach[axis] / two_pi * (two_pi * (rho + sum(grown))).exp()
                tail = 4 * B * (-points[axis] * far).exp() / (1 - (-far).exp())
                missed[axis] = tail if tail < missed[axis] else missed[axis]
        errors[j] = missed[0] + constants[0] * (missed[1] + constants[1] * errors[j])
    return conclusion([high * x for x in largest], rho, divisors, period, errors, n, p, k)


def lebesgue(n):
    """Lebesgue's constant of interpolation at n Chebyshev points."""
    if n == 1:
        return arb(1)
    return sum((arb(2 * i + 1) / (4 * n)).cot_pi() for i in range(n)) / n


def sizes(f):
    return arb_poly([abs(x) for x in f])


def real_norm(sizes, r):
    """Σ_k a_|k| r^|k|."""
    return 2 * sizes(r) - sizes[0]


def slope(f):
    """Modes of g_j' = 1 + u_j'."""
    half = [acb(1), *(acb(0, 2 * arb.pi() * i) * x for i, x in enumerate(f) if i)]
    return [x.conjugate() for x in half[:0:-1]] + half


class Grid:
    """n points of φ, n > 2K, on which sin 2πg_j is taken under one of the forcings.

    A mode and its aliases k + n, k + 2n, … are one sum. Each of the modes |k| ≥ n/2 is left out
    once, and is an alias once, of a mode that weighs less. With ‖sin 2πg_j‖ ≤ M for ρ̂ > ρ both
    together are at most 2M e^{-2π(ρ̂-ρ)n/2}.
    """

    def __init__(self, rho, sizes):
        """sizes : for each j a polynomial whose coefficients are bounds of |û_k|, k ≥ 0."""
        two_pi = 2 * arb.pi()
        self.half = 1 << (3 * max(map(len, sizes)) // 2).bit_length()
        self.r, self.missed = (two_pi * rho).exp(), []
        for f in sizes:
            tries = [rho * (1 + arb(i) / 4) for i in range(1, 60)]
            logs = [
                two_pi * (hat + 2 * f((two_pi * hat).exp()) + (rho - hat) * self.half)
                for hat in tries
            ]
            self.missed.append(2 * min(logs, key=lambda x: float(x.upper())).exp())
        self.angles = [arb(i) / self.half for i in range(2 * self.half)]

    def residuals(self, kappa, u, alpha):
        """Bounds of ‖E_j‖. u : for each j the polynomial of the modes û_k, k ≥ 0."""
        half, two_pi, errors = self.half, 2 * arb.pi(), []
        u = [[*f.coeffs(), *[acb(0)] * (half - len(f))] for f in u]
        turns = [acb(2 * k * alpha).exp_pi_i() for k in range(half)]
        for j, strength in enumerate(kappa):
            values = acb.dft([*(x.conjugate() for x in u[j]), acb(0), *u[j][:0:-1]])
            angles = zip(self.angles, values, strict=True)
            sines = acb.dft([(angle + 2 * x.real).sin_pi() / (2 * half) for angle, x in angles])
            rows = u[(j + 1) % len(u)], u[j - 1], u[j], sines[:half], turns
            E = [
                turn * after + turn.conjugate() * before - 2 * x - strength / two_pi * sine
                for after, before, x, sine, turn in zip(*rows, strict=True)
            ]
            missed = abs(strength) / two_pi * self.missed[j]
            errors.append(real_norm(sizes(E), self.r) + missed)
        return errors


def half_modes(re, im, unit):
    length = max(len(re), len(im))
    re, im = ([*part, *[0] * (length - len(part))] for part in (re, im))
    demand(not im[:1] or im[0] == 0, "a function that is not real")
    return acb_poly([acb(a * unit, b * unit) for a, b in zip(re, im, strict=True)])


def at_points(moves, points):
    """(angle of σ, of t, the functions u_j there) at all of the Chebyshev points."""
    for angle in [arb(2 * i + 1) / (2 * points[0]) for i in range(points[0])]:
        rows = {}  # Σ_m C_jml T_m(σ), by l
        for (m, degree), functions in moves.items():
            before = rows.get(degree, [acb_poly()] * len(functions))
            T = (m * angle).cos_pi()
            rows[degree] = [a + f * T for a, f in zip(before, functions, strict=True)]
        for beside in [arb(2 * i + 1) / (2 * points[1]) for i in range(points[1])]:
            terms = [[f * (m * beside).cos_pi() for f in row] for m, row in rows.items()]
            yield angle, beside, [sum(column, acb_poly()) for column in zip(*terms, strict=True)]
