"""An independent program that checks certificates in ball arithmetic: slow but simple.

    python certificate_checker.py FILE …   # prints the claims of the certificates in the files
    check(json.loads(text))   # returns the claim, which is then proved, or raises Refuted

It needs only python-flint, and shares no code with the programs that make the certificates.
nasm/proofs/README.md, "Certificates", describes the fields and states the ten theorems.

*Transport.* Given a forcing, or a cell of forcings, and boxes with their lifetimes N, the program
verifies that the boxes cover the initial conditions on a curve, and that for each box there is a
sequence η of finite support for which the second variation along every orbit in the box is

    Q = Σ_k η_k ((2 + κ_k cos 2πx_k) η_k - η_{k+1} - η_{k-1}) ≤ 0.

On a symmetry line η is even, and only half of Q is summed. On a polygon η = 1 at the site of the
curve, and both halves are summed: the sites from there on, and the earlier ones. The orbits in a
box are

    x_k = x̂_k + ξ_k σ + σᵀ B_k σ + ρ_k,   |σ_i| ≤ 1,

where the numbers x̂_k, the rows ξ_k and the symmetric matrices B_k have 128 bits and, after the
first two sites, are treated as exact; the bound on ρ_k includes their rounding errors. One
parameter σ_i describes the initial condition; in a cell there are two more, for the strengths
k + Σ_i σ_i h_i. Any sequence of floats may serve as η.

*A barrier.* The claim is about one forcing or a whole patch (called a "fan" in certificates).
Functions are Laurent polynomials in z = e^{2πiφ} with balls as coefficients. With g_j = φ + u_j,
‖1/g_j'‖ is bounded by means of ‖1 - g_j'd‖, where d ≈ 1/g_j' may be any Laurent polynomial. The
sine is evaluated on a grid of φ, for several forcings of a patch; `Grid` bounds the aliasing
errors.

A certificate may come from anyone. Before anything is computed, `within_limits` refuses it if the
check would take too much time or memory.
"""

import hashlib
import json
import lzma
import re
import struct
import sys
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from functools import reduce
from pathlib import Path
from typing import Any, TypeAlias

from flint import acb, acb_poly, arb, arb_mat, arb_poly, ctx, fmpq

__all__ = ["Refuted", "check"]

Certificate: TypeAlias = dict[str, Any]
"""A JSON object."""

Ball: TypeAlias = Any
"""A real or complex ball of FLINT, `arb` or `acb`."""

Cuboid: TypeAlias = tuple[tuple[Fraction, Fraction], ...]

BITS = 192

# Larger certificates are refused before anything is computed.
MAX_PERIOD = 64  # kicks
MAX_ORIGINAL_PERIOD = 1000  # kicks, before the forcing was shortened
MAX_LIFETIME = 10**5  # kicks of one box
MAX_TOTAL_KICKS = 10**7  # kicks of all boxes: eight minutes
MAX_QUOTIENTS, MAX_DIGITS = 200, 50  # quotients of ω, and digits of each quotient
MAX_DEGREES = 64  # in s, and in t
MAX_UNIT = 10**4  # limit on |unit| in 2^unit, and on the bits of the integers in a function
_MAX_SPREAD = 1000  # turns between orbits in a box; above it, bounds grow like 4 to the power 4^n
MAX_MODES = 3 * 10**7  # modes of the longest function, times points, times kicks: one to two hours

_TRANSPORT = {"site", "boxes", "lives"}
_BARRIER = {"omega", "rho", "moves"}
_PLANE = "origin", "first", "second"
# For each theorem: digest of its statement, and the fields besides claim, theorem and sha256.
THEOREMS = {
    "Transport is global": (
        "262141d95693b0b62f3f795cda61e9e083a5385af394d67e85edbe1571432456",
        _TRANSPORT | {"kappa", "a", "shortened_from"},
    ),
    "Transport is global under several kicks": (
        "c1fbdccdea0195bf4b321a527d9b0984f55a0f1bf7a78dba1f59f19aa76e3e01",
        _TRANSPORT | {"kappa", "points", "shortened_from"},
    ),
    "Transport is global in a cell": (
        "252fcfc01d65f0889b4a0b174de5a6003b903e8f7f0525d1c64b8a26d954ebb8",
        _TRANSPORT | {"kappa", "a", "half_width"},
    ),
    "A barrier exists": (
        "39e7a1e397c5a92e49d751f8f00d1d304498a8c6402f591b2eea56ea3c2a93c2",
        _BARRIER | {"kappa", "shortened_from"},
    ),
    "A barrier exists in a fan": (
        "6005a30ef68f1016cd6eb6f93af43ac9da23d17acad3487e6d00bf2b294f0fc2",
        _BARRIER | {"kappa", "shortened_from", "tilt", "scales"},
    ),
    "Transport is global in a cell of a plane": (
        "26a76f764f92e1fda7615db5a3c2133bbe50d04d1bcb0200040076dae86a84e0",
        _TRANSPORT | {"plane", "centre", "half_width", "points"},
    ),
    "A barrier exists in a patch of a plane": (
        "a10d1d000a629702e0ec991e8936f7aac412e70231025aac75e281e0c8ea1814",
        _BARRIER | {"plane", "centre", "tilt", "scales"},
    ),
    "A barrier exists by an explicit step": (
        "4cf90fcef4573221fb8c5fc56576fd35bf4e5d82598861eae43448cb9fe27c0c",
        _BARRIER | {"kappa", "shortened_from"},
    ),
    "A barrier exists in a fan by explicit steps": (
        "5fe9f8e0250ebd8163f6ca70ae73a5b70e8142f5f7c8b192d1d0f0288c7408f9",
        _BARRIER | {"kappa", "shortened_from", "tilt", "scales"},
    ),
    "A barrier exists in a patch of a plane by explicit steps": (
        "28efc222370a12e53dd8b81408034b1e7cbe8ae800b56e3b2d52823ab3f0dbd3",
        _BARRIER | {"plane", "centre", "tilt", "scales"},
    ),
}
STEPPED = {name for name in THEOREMS if name.endswith(("explicit step", "explicit steps"))}


class Refuted(Exception):
    """The certificate does not prove its claim."""


def check(certificate: Certificate, max_kicks: float = MAX_TOTAL_KICKS) -> str:
    """Check a certificate, and return its claim, which is then proved.

    Parameters
    ----------
    certificate : dict
        A JSON object; see nasm/proofs/README.md, "Certificates".
    max_kicks : float
        For transport, maximum number of kicks in all boxes together; each kick takes about
        5·10⁻⁵ s.

    Raises
    ------
    Refuted
        If the certificate is malformed or too large, or does not prove its claim.

    Examples
    --------
    >>> from nasm.proofs import barrier
    >>> from nasm.proofs.certificate_checker import check
    >>> certificate = barrier.prove("gamma", (0.3,)).certificate()
    >>> check(certificate)
    'a rotational invariant circle of [0;(1)] exists under the forcing (0.3)'
    >>> check(certificate | {"omega": "[0;(2)]"})
    Traceback (most recent call last):
    nasm.proofs.certificate_checker.Refuted: the seal is broken
    """
    try:
        return _checked(certificate, max_kicks)
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


def _checked(certificate: Certificate, max_kicks: float) -> str:
    data = {key: value for key, value in certificate.items() if key != "sha256"}
    text = json.dumps(data, sort_keys=True).encode()
    demand(hashlib.sha256(text).hexdigest() == certificate.get("sha256"), "the seal is broken")
    name = data["theorem"]["name"]
    digest, fields = THEOREMS[name]
    message = "the statement of the theorem differs from the checker's"
    demand(data["theorem"] == {"name": name, "version": 1, "sha256": digest}, message)
    demand(type(data["theorem"]["version"]) is int, message)
    demand(data.keys() == {"claim", "theorem", *fields}, "fields are missing or unknown")
    within_limits(data, max_kicks)
    demand(data["claim"] == claim(data), f"the statement claimed is not {claim(data)!r}")
    if "shortened_from" in data:
        shortened(data)
    if "points" in data and "plane" in data:
        hypothesis_of_plane(data)
    elif "points" in data:
        hypothesis_of_several(data)
    elif "boxes" in data:
        hypothesis(data)
    else:
        with ctx.workprec(BITS):
            holds, constants = theorem(data)
        demand(holds, f"an inequality of the theorem fails: {constants}")
    return data["claim"]


def within_limits(data: Certificate, max_kicks: float) -> None:
    """Refute unless all fields have the right types, and none is too large to be checked."""
    original = data.get("shortened_from", {})
    demand(type(original) is dict, "shortened_from is not an object")
    if "plane" in data:
        within_limits_of_plane(data["plane"])
    middle = "centre" if "plane" in data else "kappa"
    message = f"{middle} is not a list of 1 to {MAX_PERIOD} numbers"
    demand(is_row(data[middle], MAX_PERIOD), message)
    demand("plane" not in data or len(data[middle]) == 2, "a plane does not have two coordinates")
    if original:
        message = f"the original forcing is not a list of 1 to {MAX_ORIGINAL_PERIOD} numbers"
        demand(is_row(original["kappa"], MAX_ORIGINAL_PERIOD), message)
    for field in {"half_width", "tilt"} & data.keys():
        message = f"{field} does not have a number for each kick, or for each coordinate"
        demand(is_row(data[field], MAX_PERIOD) and len(data[field]) == len(data[middle]), message)
    if "boxes" in data:
        within_limits_of_boxes(data, max_kicks)
    else:
        for omega in (data["omega"], original.get("omega", data["omega"])):
            quotients(omega)
        within_limits_of_moves(data)


def within_limits_of_plane(plane: Any) -> None:
    """Refute unless a plane consists of three rows of equal length."""
    demand(type(plane) is dict and plane.keys() == {*_PLANE}, "the plane is not three rows")
    message = f"the plane is not three rows of equal length, of 1 to {MAX_PERIOD} numbers"
    demand(all(is_row(row, MAX_PERIOD) for row in plane.values()), message)
    demand(len({len(row) for row in plane.values()}) == 1, message)


def n_kicks(data: Certificate) -> int:
    """Return the number of kicks per period, after shortening."""
    return len(data["plane"]["origin"] if "plane" in data else data["kappa"])


def within_limits_of_boxes(data: Certificate, max_kicks: float) -> None:
    """Refute unless boxes and lifetimes have the right types and are not too large."""
    boxes, lives = data["boxes"], data["lives"]
    several = "points" in data
    demand(type(lives) is list and lives, "lives is not a list")
    demand(is_whole(data["site"]), "site is not an integer")
    if several:
        message = "lives are not in pairs, forwards and backwards"
        demand(all(type(pair) is list and len(pair) == 2 for pair in lives), message)
    kicks = [lifetime for pair in lives for lifetime in pair] if several else lives
    message = f"lives are not integers from 1 to {MAX_LIFETIME}"
    demand(all(is_whole(lifetime) and 1 <= lifetime <= MAX_LIFETIME for lifetime in kicks), message)
    demand(sum(kicks) <= max_kicks, f"boxes have more than {max_kicks} kicks in all")
    columns = 7 if "plane" in data else 3 if several else 9 if "half_width" in data else 2
    message = f"boxes are not {columns} strings with 16 digits for each lifetime"
    demand(type(boxes) is list and len(boxes) == columns, message)
    demand(all(type(column) is str and len(column) == 16 * len(lives) for column in boxes), message)
    if several:
        points = data["points"]
        message = "points are not pairs, or fewer than 2, or more than the boxes can join"
        demand(type(points) is list and 2 <= len(points) <= len(lives) + 1, message)
        demand(all(is_row(point, 2) and len(point) == 2 for point in points), message)
    else:
        demand(type(data["a"]) in (int, float), "a is not a number")


def within_limits_of_moves(data: Certificate) -> None:
    """Refute unless the functions of a circle have the right types and are not too large."""
    demand(0 < exact(data["rho"]) <= 1, "rho is not from 0 to 1")
    if "scales" in data:
        demand(is_row(data["scales"], 2) and len(data["scales"]) == 2, "scales are not 2 numbers")
    demand(data["moves"].keys() == {"unit", "numbers"}, "moves are not a unit and numbers")
    unit, numbers = data["moves"]["unit"], data["moves"]["numbers"]
    message = f"the unit is not an integer from -{MAX_UNIT} to {MAX_UNIT}"
    demand(is_whole(unit) and abs(unit) <= MAX_UNIT, message)
    for rows in (numbers, *numbers):
        message = f"functions do not have 1 to {MAX_DEGREES} degrees in s, and in t"
        demand(type(rows) is list and 1 <= len(rows) <= MAX_DEGREES, message)
    longest = 0
    for functions in (functions for rows in numbers for functions in rows):
        message = "not one function for each kick"
        demand(type(functions) is list and len(functions) == n_kicks(data), message)
        message = f"a function is not two lists of integers of at most {MAX_UNIT} bits"
        for parts in functions:
            demand(type(parts) is list and len(parts) == 2, message)
            for part in parts:
                demand(type(part) is list, message)
                demand(all(is_whole(x) and x.bit_length() <= MAX_UNIT for x in part), message)
                longest = max(longest, len(part))
    points = (len(numbers) + 3) * (max(map(len, numbers)) + 3)
    demand(longest * points * n_kicks(data) <= MAX_MODES, "too many modes, points and kicks")


def is_whole(x: Any) -> bool:
    """Return True for an int; False for a bool, or a float that equals an integer."""
    return type(x) is int


def is_row(texts: Any, max_length: int) -> bool:
    """Return True for a list of 1 to max_length numbers, each in the format of `float.hex`."""
    return type(texts) is list and 1 <= len(texts) <= max_length and all(map(is_number, texts))


def is_number(text: Any) -> bool:
    """Return True for a number in the format of `float.hex`; refute otherwise."""
    return exact(text) is not None


def claim(data: Certificate) -> str:
    """Return the claim that the certificate must make; it is about the original forcing."""
    original = data.get("shortened_from", data)
    middle = decimals(original["centre" if "plane" in data else "kappa"])
    under = f"the forcing {middle}"
    if "half_width" in data:
        under = f"every forcing within {decimals(data['half_width'])} of {middle}"
    elif "scales" in data:
        low, high = (repr(float.fromhex(number)) for number in data["scales"])
        if any(map(exact, data["tilt"])):
            middle = f"({middle} + t {decimals(data['tilt'])}), -1 <= t <= 1"
        of = "every forcing with coordinates" if "plane" in data else "every forcing"
        under = f"{of} from {low} to {high} times {middle}"
    if "plane" in data:
        rows = (decimals(data["plane"][name]) for name in _PLANE)
        under += " in the plane {} + a {} + b {}".format(*rows)
    if "omega" in original:
        return f"a rotational invariant circle of {original['omega']} exists under {under}"
    return f"transport is global under {under}"


def decimals(numbers: list[str]) -> str:
    """Write hexadecimal numbers as decimals with enough digits to recover each float exactly."""
    return f"({', '.join(repr(float.fromhex(number)) for number in numbers)})"


def shortened(data: Certificate) -> None:
    """Refute unless the forcing and ω are the original ones, unchanged or correctly shortened.

    Either the original κ repeats the shortened one, or only every m-th site is kicked and the
    original repeats the shortened one up to alternating signs. These signs are equivalent to an
    extra advance of x by 1/2 from each kicked site to the next.
    """
    original = data["shortened_from"]
    long, short = (
        [exact(k) for k in strengths] for strengths in (original["kappa"], data["kappa"])
    )
    n_long, n_short = len(long), len(short)
    demand(
        n_short > 0 and n_long % n_short == 0,
        "the length of the shortened forcing does not divide that of the original one",
    )
    demand(
        original.keys() == {"kappa", "omega"} & data.keys(),
        "fields of shortened_from are missing or unknown",
    )
    repeated = short * (n_long // n_short)
    turns = [Fraction(0)] if long == repeated else []  # extra turns per period, beyond ω
    for spacing in (m for m in range(1, n_long // 2 + 1) if n_long % (2 * m) == 0):
        for first in range(spacing):
            signs = [0] * n_long
            signs[first :: 2 * spacing] = [1] * (n_long // (2 * spacing))
            signs[first + spacing :: 2 * spacing] = [-1] * (n_long // (2 * spacing))
            pairs = zip(signs, long, repeated, strict=True)
            if all(k == sign * kept and (sign or not kept) for sign, k, kept in pairs):
                turns.append(Fraction(n_long, 2 * spacing))
    demand(turns, "the forcing is not the original one, shortened")
    if "omega" in data:
        if any(map(exact, data.get("tilt", []))):
            demand(long == short, "forcings in several directions cannot be shortened")
            turns = [Fraction(0)]  # other forcings of the patch lack the symmetry of κ
        (a, b), (a_short, b_short) = surd(original["omega"]), surd(data["omega"])
        times = Fraction(n_long, n_short)
        same = [((a_short * times - a - turn) / n_long).denominator == 1 for turn in turns]
        demand(b_short * times**2 == b and any(same), "omega is not the original one, shortened")


def surd(text: str) -> tuple[Fraction, Fraction]:
    """Return (a, ±b²) for ω = a ± b, where b is the square root of a fraction."""
    head, tail = quotients(text)
    (p, p_last), (q, q_last) = product(tail)  # x = (p x + p')/(q x + q') = (r + √d)/t
    r, t, d = p - q_last, 2 * q, (q_last - p) ** 2 + 4 * q * p_last
    (p, p_last), (q, q_last) = product(head)
    a, b, above, below = p * r + p_last * t, p, q * r + q_last * t, q
    norm = above**2 - d * below**2
    root = Fraction(b * above - a * below, norm)
    return Fraction(a * above - d * b * below, norm), root * abs(root) * d


def product(quotients: list[int]) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return ((p, p'), (q, q')), numerators and denominators of the last two convergents."""
    p, q = (1, 0), (0, 1)
    for a in quotients:
        p, q = (a * p[0] + p[1], p[0]), (a * q[0] + q[1], q[0])
    return p, q


def exact(text: Any) -> Fraction:
    """Read a number in the format of `float.hex`; refute others: "0.5" would be read as 5/16."""
    demand(type(text) is str and len(text) <= 24, "a number is not a string of up to 24 characters")
    try:
        number = float.fromhex(text)
        demand(number.hex() == text, f"{text!r} is not as float.hex writes it")
        return Fraction(*number.as_integer_ratio())
    except (ValueError, OverflowError):
        raise Refuted(f"{text!r} is not a number") from None


def rows(columns: list[str]) -> list[tuple[Fraction, ...]]:
    """Decode columns, hexadecimal strings of 16 digits per number, into rows of exact numbers."""
    data = [bytes.fromhex(column) for column in columns]
    numbers = [map(Fraction, struct.unpack(f">{len(each) // 8}d", each)) for each in data]
    return list(zip(*numbers, strict=True))


def demand(truth: Any, complaint: str) -> None:
    """Refute the certificate unless `truth` is true."""
    if not truth:
        raise Refuted(complaint)


# --- transport is global --------------------------------------------------------------------------


def hypothesis(certificate: Certificate) -> None:
    """Refute unless the hypothesis of "Transport is global" holds, for a forcing or a cell."""
    kappa = [exact(strength) for strength in certificate["kappa"]]
    widths = [exact(width) for width in certificate.get("half_width", [(0.0).hex()] * len(kappa))]
    site, a, lives = certificate["site"], Fraction(certificate["a"]), certificate["lives"]
    largest = [abs(strength) + width for strength, width in zip(kappa, widths, strict=True)]
    demand(len(kappa) == 1 or (len(kappa) == 2 and min(largest) < 2), "the theorem does not apply")
    demand(site in range(len(kappa)) and a in (0, Fraction(1, 2)), "not a symmetry line")
    boxes = rows(certificate["boxes"])
    demand(len(boxes) == len(lives), "not one lifetime for each box")
    kappa, widths = kappa[site:] + kappa[:site], widths[site:] + widths[:site]
    if "half_width" in certificate:
        pieces: dict[Fraction, list[tuple[Fraction, ...]]] = {}
        for box in boxes:
            pieces.setdefault(box[-1], []).append(box)
        covered = [cover_of_piece(group, kappa, widths) for group in pieces.values()]
    else:
        covered = [(y - delta, y + delta) for y, delta in boxes]
        strengths = [number for k in kappa for number in (k, Fraction(0))]
        boxes = [(*box, *strengths) for box in boxes]
    cover(covered, Fraction(1, 2))
    for box, lifetime in zip(boxes, lives, strict=True):
        demand(isinstance(lifetime, int) and lifetime > 0, f"a lifetime of {lifetime!r} kicks")
        bound = second_variation(a, box, lifetime)
        demand(bound <= 0, f"Q/2 may be {bound} in the box {[float(number) for number in box]}")


def cover(
    intervals: list[tuple[Fraction, Fraction]], end: Fraction, begin: Fraction = Fraction(0)
) -> None:
    """Refute unless the intervals cover [begin, end]."""
    reached = begin
    for left, right in sorted(intervals):
        demand(left < right and left <= reached, f"a gap beyond {float(reached)}")
        reached = max(reached, right)
    demand(reached >= end, f"a gap beyond {float(reached)}")


def hypothesis_of_several(certificate: Certificate) -> None:
    """Refute unless the hypothesis of "Transport is global under several kicks" holds."""
    kappa = [exact(strength) for strength in certificate["kappa"]]
    points, boxes, site = curve(certificate, kappa)
    lives = certificate["lives"]
    cover([(s - delta, s + delta) for s, delta, _ in boxes], Fraction(len(points) - 1, 2))
    ahead = kappa[site:] + kappa[:site]
    for (s, delta, split), lifetime in zip(boxes, lives, strict=True):
        piece = int(2 * (s - delta))
        demand(2 * (s + delta) <= piece + 1, "a box extends across a corner")
        start = on_the_segment(points, piece, s, delta)
        both_halves(start, split, [(k,) for k in ahead], lifetime, f"the box at {float(s)}")


def curve(
    certificate: Certificate, largest: list[Fraction]
) -> tuple[list[tuple[Fraction, ...]], list[tuple[Fraction, ...]], int]:
    """Return the corners of a curve, its boxes, and its site.

    Refute unless kicks no stronger than `largest` yield a twist map for some choice of the first
    kick, and the images of the curve continue the curve.
    """
    is_twist = any(is_positive(largest[m + 1 :] + largest[:m]) for m in range(len(largest)))
    demand(is_twist, "the theorem does not apply")
    points = [tuple(exact(number) for number in point) for point in certificate["points"]]
    ends = {(2 * x).denominator * (2 * y).denominator for x, y in (points[0], points[-1])}
    demand(
        ends == {1} and points[0][1] != points[-1][1], "the images of the curve do not continue it"
    )
    boxes, site = rows(certificate["boxes"]), certificate["site"]
    is_matched = site in range(len(largest)) and len(boxes) == len(certificate["lives"])
    demand(is_matched, "site or lives does not match")
    return points, boxes, site


def on_the_segment(
    points: list[tuple[Fraction, ...]], piece: int, s: Fraction, delta: Fraction
) -> tuple[tuple[Fraction, Fraction], tuple[Fraction, Fraction]]:
    """Return x and y in the middle of a box on a segment, and their changes to the box's end."""
    (x, y), (x_end, y_end) = points[piece : piece + 2]
    dx, dy, part = x_end - x, y_end - y, 2 * s - piece
    return (x + part * dx, y + part * dy), (2 * delta * dx, 2 * delta * dy)


def both_halves(
    start: Any,
    split: Fraction,
    kicks: Sequence[tuple[Fraction, ...]],
    lifetime: list[int],
    place: str,
) -> None:
    """Refute unless both halves of Q are at most 0 in a box.

    start : as returned by `on_the_segment`. kicks : k and the h_i of each kick, beginning with the
    kick at the curve.
    """
    demand(Fraction(float(1 - split)) == 1 - split, "a part of the site is not a float")
    for half, ahead, n in zip(halves(start, split), (kicks, kicks[::-1]), lifetime, strict=True):
        demand(isinstance(n, int) and n > 0, f"a lifetime of {n!r} kicks")
        with ctx.workprec(128):
            eta, *orbit = [[ball(number) for number in pair] for pair in half]
            strengths = [(ball(k), [ball(width) for width in widths]) for k, *widths in ahead]
            orbit += [[arb(0), arb(0)]] * len(strengths[0][1])
            bound, _ = summed(orbits(orbit, strengths, n), eta[0], float(half[0][1]))
        demand(bound <= 0, f"half of Q may be {bound} in {place}")


def hypothesis_of_plane(certificate: Certificate) -> None:
    """Refute unless the hypothesis of "Transport is global in a cell of a plane" holds.

    For each segment of the curve, the boxes must tile the product of the segment and the cell.
    """
    matrix = ([exact(x) for x in certificate["plane"][name]] for name in _PLANE)
    plane = list(zip(*matrix, strict=True))
    centre, widths = ([exact(x) for x in certificate[key]] for key in ("centre", "half_width"))
    demand(min(widths) > 0, "the half width of the cell is not positive")
    largest = [
        abs(o + sum(x * move for x, move in zip(centre, moves, strict=True)))
        + sum(width * abs(move) for width, move in zip(widths, moves, strict=True))
        for o, *moves in plane
    ]
    points, boxes, site = curve(certificate, largest)
    ahead = plane[site:] + plane[:site]
    segments: list[list[Cuboid]] = [[] for _ in points[1:]]
    cell = [(x - width, x + width) for x, width in zip(centre, widths, strict=True)]
    for s, delta, a, h_a, b, h_b, _ in boxes:
        demand(min(delta, h_a, h_b) > 0, "the width of a box is not positive")
        piece = int(2 * (s - delta))
        demand(0 <= piece < len(segments), "a box is on no segment of the curve")
        segments[piece].append(((s - delta, s + delta), (a - h_a, a + h_a), (b - h_b, b + h_b)))
    for i, cuboids in enumerate(segments):
        whole = ((Fraction(i, 2), Fraction(i + 1, 2)), *cell)
        demand(tile(whole, cuboids), "the boxes do not tile a segment of the curve times the cell")
    for box, lifetime in zip(boxes, certificate["lives"], strict=True):
        s, delta, a, h_a, b, h_b, split = box
        start = on_the_segment(points, int(2 * (s - delta)), s, delta)
        kicks = [(o + a * f + b * g, h_a * f, h_b * g) for o, f, g in ahead]
        both_halves(start, split, kicks, lifetime, f"the box {[float(x) for x in box]}")


def is_positive(kappa: list[Fraction]) -> bool:
    """Return True if the matrix with diagonal 2 - |κ_j| and -1 next to it is positive definite."""
    pivot = None
    for k in kappa:
        pivot = 2 - abs(k) - (1 / pivot if pivot else 0)
        if pivot <= 0:
            return False
    return True


def halves(start: Any, split: Fraction) -> tuple[tuple[tuple[Any, Any], ...], ...]:
    """Return η, x, v and t of both halves of Q, each at the site before the first and at the first.

    One half begins at the site of the curve; the other, with x_{c-n} → -x_{c-n}, begins at the site
    before it. In the half that begins at the site of the curve, η at the site before is taken as
    1 - split, which is also η at the first site of the other half.
    """
    # Any slope for which v and t are not parallel is valid. Choose split, or split + 1 if split
    # would make them nearly parallel.
    (x, y), (x_width, y_width) = start
    near = abs(y_width - split * x_width) < (abs(x_width) + abs(y_width)) / 10_000
    slope = split + near
    ahead = (1 - split, 1), (x - y, x), (1 - slope, 1), (x_width - y_width, x_width)
    behind = (1, 1 - split), (-x, y - x), (1, 1 - slope), (-x_width, y_width - x_width)
    return ahead, behind


def cover_of_piece(
    boxes: list[tuple[Fraction, ...]], kappa: list[Fraction], widths: list[Fraction]
) -> tuple[Fraction, Fraction]:
    """Return the interval of y that boxes with the same shear cover for every κ in the cell.

    In the coordinates u = y - g_0 κ_0 - g_1 κ_1, κ_0 and κ_1 the boxes are cuboids, and they must
    tile a cuboid.
    """
    (shears,) = {box[6:8] for box in boxes}
    cuboids = []
    for y, delta, k0, h0, k1, h1, *_ in boxes:
        demand(min(delta, h0, h1) > 0, "the width of a box is not positive")
        u = y - shears[0] * k0 - shears[1] * k1
        cuboids.append(((u - delta, u + delta), (k0 - h0, k0 + h0), (k1 - h1, k1 + h1)))
    left = min(cuboid[0][0] for cuboid in cuboids)
    right = max(cuboid[0][1] for cuboid in cuboids)
    cell = [(k - h, k + h) for k, h in zip(kappa, widths, strict=True)]
    demand(tile(((left, right), *cell), cuboids), "the boxes do not tile their piece of the cell")
    moves = [[shear * end for end in ends] for shear, ends in zip(shears, cell, strict=True)]
    return left + sum(map(max, moves)), right + sum(map(min, moves))


def tile(whole: Cuboid, cuboids: Sequence[Cuboid]) -> bool:
    """Return True if cuboids made by bisection tile `whole`; the test repeats the bisections."""
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


def ball(fraction: Fraction) -> Ball:
    """Return a fraction as a ball."""
    return arb(fmpq(fraction.numerator, fraction.denominator))


def second_variation(a: Fraction, box: Sequence[Fraction], lifetime: int) -> Ball:
    """Bound Q/2 from above in a box on a symmetry line, for an even η chosen here.

    box : ŷ, δ, then k and h of each strength, beginning with the kick at x = a; in a cell, the
    shears follow.
    """
    with ctx.workprec(128):
        (begun, strengths), eta = on_a_line(a, box)
        return summed(orbits(begun, strengths, lifetime), *eta)[0]


def on_a_line(a: Fraction, box: Sequence[Fraction]) -> tuple[Any, tuple[Any, ...]]:
    """Return the arguments of `orbits`, and of `summed`, for a box as in `second_variation`."""
    y, delta, *strengths = (ball(number) for number in box[:6])
    k, widths = strengths[::2], strengths[1::2]
    # Each strength depends on a separate parameter.
    kicks = [(x, [w if i == j else arb(0) for j, w in enumerate(widths)]) for i, x in enumerate(k)]
    shears = [ball(number) for number in box[6:8]] or [arb(0)] * len(k)
    moves = [delta, *(shear * width for shear, width in zip(shears, widths, strict=True))]
    before = 1 + k[0] / 2 * (1 if a == 0 else -1)  # η after the site, before it is raised
    begun = (ball(a) - y, ball(a)), (before, arb(1)), *((-move, arb(0)) for move in moves)
    return (begun, kicks), (before, 1.0, fmpq(1, 2))


def summed(
    sites: Iterable[tuple[Ball, arb_mat, arb_mat, Ball]], before: Ball, first: float, share: Any = 1
) -> tuple[Ball, list[float]]:
    """Bound from above the sum of Q over the sites that `orbits` yields; return the bound and η.

    η is chosen here, in floats: a solution of the linearised equation in the middle of the box,
    raised to offset the amount by which Q may exceed its value in the middle. It is cut off where
    it would not be positive.

    before, first : η at the site before the first one, and at the first one. share : weight of the
    first site, 1 or 1/2; if it is 1/2, η is even about that site, and `before` only affects the
    choice of η.
    """
    last, eta, paid = float(before.mid()), [first], 0.0
    middle = rest = arb(0)
    linear = quadratic = 0
    for n, (cosine, row, matrix, bound) in enumerate(sites):
        # The rest of the first site belongs to the other half of Q.
        square = arb(eta[n]) ** 2 * (share if n == 0 else 1)
        neighbours = 2 * arb(eta[n - 1]) if n > 0 else before if share == 1 else 0
        middle += square * (2 + cosine) - eta[n] * neighbours
        linear, quadratic = row * square + linear, matrix * square + quadratic
        rest += square * bound
        excess = largest_value(linear, quadratic) + rest
        due = max(0.0, float(excess.mid()) - paid)
        paid += due
        after = (2 + float(cosine.mid())) * eta[n] - last + due / eta[n]
        if not after > 0:
            break
        last = eta[n]
        eta.append(after)
    return middle + upper(excess), eta[: n + 1]


def orbits(
    begun: Any, strengths: Sequence[tuple[Ball, list[Ball]]], lifetime: int
) -> Iterator[tuple[Ball, arb_mat, arb_mat, Ball]]:
    """Yield balls for each site: κ cos 2πx = [0] + [1]σ + σᵀ[2]σ ± [3] on the box, |σ_i| ≤ 1.

    [1] is a row, and [2] a symmetric matrix.

    begun : x, v, and the change of x with each parameter, at the site before the first and at the
    first. The first parameter is that of the initial condition. strengths : k and its change with
    each of the other parameters, for each kick, beginning with the first site.
    """
    pi, two_pi = arb.pi(), 2 * arb.pi()
    # Taylor coefficients of (sin 2πx)/2π from the second order on, without signs: π and these.
    third, fourth = 2 * pi**2 / 3, pi**3 / 3
    (x_last, x), (v_last, v), *both = begun
    moves_last, moves = (arb_mat([row]) for row in zip(*both, strict=True))
    bends_last = bends = arb_mat(len(both), len(both))
    ones = arb_mat([[arb(1)]] * len(both))
    kicks = [
        (k, upper(k), arb_mat([[arb(0), *widths]]), sum(map(upper, widths), arb(0)))
        for k, widths in strengths
    ]
    on_v = on_t = arb(0)  # |ρ| ≤ on_v |v| + on_t |t|
    for n in range(lifetime):
        k, strength, changes, width = kicks[n % len(kicks)]
        sine, cosine = (2 * x).sin_cos_pi()
        sine_bound, cosine_bound = upper(sine), upper(cosine)
        # x - x̂ = ξ + σᵀ bends σ + ρ, ξ = moves σ
        v_bound, t_bound = upper(v), upper(moves[0, 0])
        rho = on_v * v_bound + on_t * t_bound
        straight = sum(map(abs, moves.entries()))
        curved = sum(map(abs, bends.entries())) + rho
        largest = straight + curved
        demand(largest < _MAX_SPREAD, f"after {n} kicks the orbits in a box are too far apart")
        squares = curved * (largest + straight)  # ≥ |(x - x̂)² - ξ²|
        square, cube = largest * largest, largest**3
        product = moves.transpose() * moves
        mixed = changes.transpose() * moves  # the change of this kick's strength, times ξ
        mixed = (mixed + mixed.transpose()) * arb(0.5)
        force, stiffness = k * sine, k * cosine
        yield (
            stiffness,
            changes * cosine - moves * (two_pi * force),
            (bends * force + product * (pi * stiffness) + mixed * sine) * -two_pi,
            strength * (two_pi * sine_bound * rho + 3 * third * cosine_bound * squares)
            + strength * 4 * fourth * cube
            # The change of the strength times the change of cos 2πx, without the term in ξ
            + width * two_pi * (sine_bound * curved + pi * square),
        )
        # By Cramer's rule, with the Wronskian v_n t_{n+1} - v_{n+1} t_n, the defect of the
        # expansion at the next site is written in terms of v and t, which have defects too.
        defect = strength * (pi * sine_bound * squares + third * cosine_bound * cube)
        defect += width * (cosine_bound * curved + pi * sine_bound * square + third * cube)
        defect += (strength + width) * fourth * square**2
        slope = 2 + stiffness
        x_next = 2 * x - x_last + force / two_pi
        v_next = slope * v - v_last
        moves_next = moves * slope - moves_last + changes * (sine / two_pi)
        bends_next = bends * slope - bends_last - product * (pi * force) + mixed * cosine
        # Exact numbers replace the balls, which would grow; the defect includes this change.
        x, x_last, v, v_last = x_next.mid(), x, v_next.mid(), v
        moves, moves_last, bends, bends_last = moves_next.mid(), moves, bends_next.mid(), bends
        defect += x_next.rad() + on_v * v_next.rad() + on_t * moves_next[0, 0].rad()
        for errors in (moves_next, ones.transpose() * bends_next):
            defect += (errors * ones)[0, 0].rad()  # at least the sum of the radii of all entries
        wronskian = arb((v_last * moves[0, 0] - v * moves_last[0, 0]).abs_lower())
        on_v += upper(defect * t_bound / wronskian)
        on_t += upper(defect * v_bound / wronskian)


def largest_value(row: arb_mat, matrix: arb_mat) -> Ball:
    """Bound row·σ + σᵀ·matrix·σ from above for |σ_i| ≤ 1; the matrix is symmetric."""
    total = arb(0)
    for i in range(row.ncols()):
        total += abs(row[0, i]) + matrix[i, i].nonnegative_part()
        for j in range(i):
            total += 2 * abs(matrix[i, j])
    return total


def upper(number: Ball) -> Ball:
    """Bound |number| from above."""
    return arb(number.abs_upper())


# --- a barrier exists -----------------------------------------------------------------------------


def norm(modes: list[Ball], r: Ball) -> Ball:
    """Return Σ_k |f_k| r^|k| for the modes -K, …, K."""
    middle = len(modes) // 2
    up, down = (sizes(half)(r) for half in (modes[middle:], modes[middle::-1]))
    return up + down - abs(modes[middle])


def multiplied(f: list[Ball], g: list[Ball]) -> list[Ball]:
    """Return the coefficients of the product of two polynomials."""
    both = acb_poly(f) * acb_poly(g)
    return [both[k] for k in range(len(f) + len(g) - 1)]


def inverse(f: list[Ball], r: Ball, most: int) -> tuple[list[Ball], Ball]:
    """Return d ≈ 1/f, f > 0, in modes |k| ≤ most, and a ball that contains ‖1 - fd‖.

    d is computed from values of f at more than 2·most points; any d is valid.
    """
    middle, zeros = len(f) // 2, [acb(0)] * ((2 << most.bit_length()) - len(f))
    values = acb.dft([*f[middle:], *zeros, *f[:middle]])
    modes = acb.dft([1 / x.mid() for x in values], inverse=True)
    d = [x.mid() for x in modes[len(modes) - most :] + modes[: most + 1]]
    defect = multiplied(f, d)
    defect[len(defect) // 2] -= 1
    return d, norm(defect, r)


def neumann(size: Ball, defect: Ball) -> Ball:
    """Bound ‖1/f‖, given ‖d‖ and ‖1 - fd‖."""
    return size / (1 - defect) if defect < 1 else arb.pos_inf()


def quotients(text: Any) -> tuple[list[int], list[int]]:
    """Parse a string like "[0;2,(1)]" into the quotients before the period, and one period."""
    most = MAX_QUOTIENTS * (MAX_DIGITS + 1)
    demand(
        type(text) is str and len(text) <= most,
        f"omega is not a string of up to {most} characters",
    )
    match = re.fullmatch(r"\[((?:-?\d+;)?(?:\d+,)*)\(((?:\d+,)*\d+)\)\]", text, re.ASCII)
    demand(match, f"{text[:40]!r} is not a quadratic irrational")
    parts = [re.findall(r"-?\d+", part) for part in match.groups()]  # type: ignore[union-attr]
    message = f"omega does not have 1 to {MAX_QUOTIENTS} quotients of at most {MAX_DIGITS} digits"
    demand(sum(map(len, parts)) <= MAX_QUOTIENTS, message)
    demand(all(len(a.lstrip("-")) <= MAX_DIGITS for part in parts for a in part), message)
    head, tail = ([int(a) for a in part] for part in parts)
    demand(min(head[1:] + tail) >= 1, f"{text[:40]!r} has a partial quotient below 1")
    return head, tail


def rotation(text: str) -> tuple[Ball, list[tuple[int, Ball]], int]:
    """Return ω as a ball, (q_n, 2|sin πq_nω|) for n = 0, 1, …, and the length of the period."""
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


def russmann(divisors: list[tuple[int, Ball]], period: int, delta: Ball) -> Ball:
    """Bound δ'e^{-2πqδ'}/divisor for all δ' ≤ δ and all denominators q."""
    worst = arb(0)
    for n, (q, divisor) in enumerate(divisors):
        peak = 1 / (2 * arb.pi() * q)
        at = delta if peak > delta and n < len(divisors) - period else peak
        term = at * (-2 * arb.pi() * q * at).exp() / divisor
        if n >= len(divisors) - period:  # the last terms recur forever, up to a relative 10^-9
            term = term * (1 + arb(10) ** -9)
        worst = worst.max(term)
    return worst


def conclusion(
    kappa: list[Ball],
    rho: Ball,
    divisors: list[tuple[int, Ball]],
    period: int,
    errors: list[Ball],
    n: list[Ball],
    p: list[Ball],
    k: list[Ball],
) -> tuple[bool, dict[str, float]]:
    """Return whether the inequalities of the theorem hold, and all of its constants."""
    eps = sum(a * b for a, b in zip(n, errors, strict=True)).max(arb(2) ** -1000)
    delta = arb("0.99") * rho / arb("4.2")
    C = russmann(divisors, period, delta) + delta
    holds, left = inequalities(kappa, delta, C, eps, n, p, k)
    constants = left | {"delta": delta, "C": C, "epsilon": eps, "error": reduce(arb.max, errors)}
    constants |= {"n": reduce(arb.max, n), "p": reduce(arb.max, p), "k": reduce(arb.max, k)}
    return holds, {name: float(x.upper()) for name, x in constants.items()}


def inequalities(
    kappa: list[Ball],
    delta: Ball,
    C: Ball,
    eps: Ball,
    n: list[Ball],
    p: list[Ball],
    k: list[Ball],
) -> tuple[bool, dict[str, Ball]]:
    """Return whether inequalities (1) to (3) hold, their left-hand sides, and the largest |κ_j|."""
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


def theorem(data: Certificate) -> tuple[bool, dict[str, float]]:
    """Return whether the theorem applies to the forcing or to the whole patch, and its constants.

    u_j = Σ_ml C_jml T_m(σ) T_l(t); a real function of φ is represented by a polynomial whose
    coefficients are its modes k ≥ 0.
    """
    rho, (omega, divisors, period) = arb(float.fromhex(data["rho"])), rotation(data["omega"])
    origin, kappa, tilt = fan(data)
    low, high = map(exact, data.get("scales", [(1.0).hex()] * 2))
    long, fanned = "scales" in data, any(tilt)
    demand(0 <= low < high or not long, "scales are not an interval")
    demand(rho > 0 and 0 < len(kappa) == len(tilt), "rho or tilt does not match")
    numbers, unit = data["moves"]["numbers"], arb(2) ** data["moves"]["unit"]
    widest = max(map(len, numbers))
    demand(long or len(numbers) == 1, "functions depend on s, but there is one forcing")
    demand(fanned or widest == 1, "functions depend on t, but the forcings are on a ray")
    functions_match = all(len(f) == len(kappa) for rows in numbers for f in rows)
    demand(functions_match, "not one function for each kick")
    moves = {
        (m, i): [half_modes(re, im, unit) for re, im in functions]
        for m, rows in enumerate(numbers)
        for i, functions in enumerate(rows)
    }
    origin, kappa, tilt = ([ball(x) for x in row] for row in (origin, kappa, tilt))
    middle, half, high = ball((low + high) / 2), ball((high - low) / 2), ball(high)

    def strengths(s, t):
        return [o + s * (a + t * b) for o, a, b in zip(origin, kappa, tilt, strict=True)]

    bounds = {m: [sizes(f) for f in row] for m, row in moves.items()}
    totals = [sum(column, arb_poly()) for column in zip(*bounds.values(), strict=True)]
    stepped = data.get("theorem", {}).get("name") in STEPPED
    wide, more = (2 * rho, 3) if stepped else (rho, 1)
    r, two_pi = (2 * arb.pi() * wide).exp(), 2 * arb.pi()
    slopes = {m: [2 * two_pi * r * f.derivative()(r) for f in row] for m, row in bounds.items()}
    n = [1 + sum(column) for column in zip(*slopes.values(), strict=True)]
    k = [(two_pi * (rho + real_norm(f, r))).exp() for f in totals]
    p, errors = [arb(0)] * len(n), [arb(0)] * len(n)
    grid = Grid(wide, totals, 2 if stepped else 1.5)
    largest_E, near, apart = [[arb(0)]] * len(n), [[arb(0)]] * len(n), [arb(0)] * len(n)
    # There are more points than degrees in s and in t, but only one in a variable that is absent.
    points = len(numbers) + more if long else 1, widest + more if fanned else 1
    # An angle differs from the nearest of N points by at most π/2N, and T_m by 2 sin(mπ/4N).
    step = [[2 * (arb(m) / (4 * N)).sin_pi() for m in range(N)] for N in points]
    moved = [arb(0)] * len(n)  # bounds on the change of g_j' from the nearest point
    for (m, i), row in slopes.items():
        moved = [x + (step[0][m] + step[1][i]) * y for x, y in zip(moved, row, strict=True)]
    for angle, beside, u in at_points(moves, points):
        there = strengths(middle + half * angle.cos_pi(), beside.cos_pi())
        found = grid.residuals(there, u, omega / len(kappa))
        demand(all(error < 1 for error in found), "a residual is not below 1")
        if stepped:
            modes, found = grid.modes, grid.rests
            largest_E = [larger(old, new) for old, new in zip(largest_E, modes, strict=True)]
        errors = [old.max(new) for old, new in zip(errors, found, strict=True)]
        for j, f in enumerate(u):
            with ctx.workprec(64):
                d, defect = inverse(slope(f), r, 2 * max(map(len, totals)))
                size = norm(d, r)
                bound = neumann(size, defect + moved[j] * size)
                p[j] = p[j].max(bound)
                if stepped:
                    apart[j] = apart[j].max(bound - size)
                    middle_of_d, d = len(d) // 2, [abs(x) for x in d]
                    both = larger(d[middle_of_d:], d[middle_of_d::-1])  # modes k and -k
                    near[j] = larger(near[j], both)
    constants = [lebesgue(N) for N in points]
    largest = [abs(a) + abs(b) for a, b in zip(kappa, tilt, strict=True)]
    for j in range(len(n)):
        missed = [arb.pos_inf() if varies else arb(0) for varies in (long, fanned)]
        for far in [arb(i) / 10 for i in range(1, 40)]:  # log r of the ellipse in σ, or in t
            out = far.cosh()
            reach = (
                abs(origin[j]) + (middle + half * out) * largest[j],
                abs(origin[j]) + high * (abs(kappa[j]) + abs(tilt[j]) * out),
            )
            for axis in (0, 1):
                grown = ((m[axis] * far).cosh() * 2 * row[j](r) for m, row in bounds.items())
                B = reach[axis] / two_pi * (two_pi * (wide + sum(grown))).exp()
                tail = 4 * B * (-points[axis] * far).exp() / (1 - (-far).exp())
                missed[axis] = tail if tail < missed[axis] else missed[axis]
        errors[j] = missed[0] + constants[0] * (missed[1] + constants[1] * errors[j])
    strongest = [abs(o) + high * x for o, x in zip(origin, largest, strict=True)]
    if stepped:
        growth = constants[0] * constants[1]
        known = [[growth * x for x in row] for row in largest_E]
        residuals, inverses = (
            list(zip(*pair, strict=True)) for pair in ((known, errors), (near, apart))
        )
        with ctx.workprec(64):
            return after_a_step(
                strongest, rho, omega, divisors, period, totals, residuals, inverses
            )
    return conclusion(strongest, rho, divisors, period, errors, n, p, k)


def fan(data: Certificate) -> tuple[list[Fraction], list[Fraction], list[Fraction]]:
    """Return o, κ and b of the forcings o + s(κ + tb) of a certificate."""
    middle = [exact(x) for x in data["centre" if "plane" in data else "kappa"]]
    tilt = [exact(x) for x in data.get("tilt", [(0.0).hex()] * len(middle))]
    if "plane" not in data:
        return [Fraction(0)] * len(middle), middle, tilt
    origin, first, second = ([exact(x) for x in data["plane"][name]] for name in _PLANE)
    kappa, beside = (
        [a * f + b * g for f, g in zip(first, second, strict=True)] for a, b in (middle, tilt)
    )
    return origin, kappa, beside


def larger(a: list[Ball], b: list[Ball]) -> list[Ball]:
    """Return the larger of two bounds for each mode."""
    longest = max(len(a), len(b))
    a, b = ([*row, *[arb(0)] * (longest - len(row))] for row in (a, b))
    return [x.max(y) for x, y in zip(a, b, strict=True)]


def after_a_step(
    kappa: list[Ball],
    rho: Ball,
    omega: Ball,
    divisors: list[tuple[int, Ball]],
    period: int,
    totals: list[arb_poly],
    residuals: list[tuple[list[Ball], Ball]],
    inverses: list[tuple[list[Ball], Ball]],
) -> tuple[bool, dict[str, float]]:
    """Return whether the theorem with an explicit first step applies, and its constants.

    Each function is bounded by a pair: f = f₁ + f₂, where the pair contains bounds on the modes
    k ≥ 0 of f₁, which also hold for -k, and a bound on ‖f₂‖ in the strip 2ρ. For the step
    v_j = g_j'w_j this strip is narrowed to 3ρ/2 by the first division by small divisors, and to ρ
    by the second. totals : polynomials whose coefficients are bounds on the modes of u_j.
    """
    P, e, two_pi, zero = len(kappa), arb(1).exp(), 2 * arb.pi(), arb(0)
    wide, middle, r = ((two_pi * x).exp() for x in (2 * rho, 3 * rho / 2, rho))
    sigma = russmann(divisors, period, rho / 2) / (rho / 2)
    slopes = [([arb(1), *[two_pi * i * x for i, x in enumerate(f)][1:]], zero) for f in totals]

    def product(f, g, at):
        modes = arb_poly(mirrored(f[0])) * arb_poly(mirrored(g[0]))
        first, size_f, size_g = len(f[0]) + len(g[0]) - 2, even_norm(f[0], at), even_norm(g[0], at)
        half = [modes[first + i] for i in range(first + 1)]
        return half, size_f * g[1] + size_g * f[1] + f[1] * g[1]

    def total(*pairs):
        length = max(len(modes) for modes, _ in pairs)
        padded = [[*modes, *[zero] * (length - len(modes))] for modes, _ in pairs]
        return [sum(column) for column in zip(*padded, strict=True)], sum(rest for _, rest in pairs)

    def solved(f):
        small = [2 * abs((omega * i).sin_pi()) for i in range(1, len(f[0]))]
        return [zero] + [x / y for x, y in zip(f[0][1:], small, strict=True)], sigma * f[1]

    forces = [product(slopes[j], residuals[j], wide) for j in range(P)]
    sums = [total(*forces[: j + 1]) for j in range(P)]
    around = solved(sums[-1])
    fluxes = [total(around, f) for f in sums]
    mean = reduce(arb.max, [even_norm(f, arb(1)) + rest for f, rest in fluxes])
    steps = []
    for j in range(P):
        inverse = product(inverses[j], inverses[(j + 1) % P], middle)
        steps.append(product(total(fluxes[j], ([mean], zero)), inverse, middle))
    first = solved(total(*steps))
    w = [total(first, *steps[:j]) for j in range(P)]
    n, p, k, errors, moved, waves = [], [], [], [], [], []
    for j in range(P):
        n_j, p_j = even_norm(slopes[j][0], r), even_norm(inverses[j][0], r) + inverses[j][1]
        k_j = (two_pi * (rho + real_norm(totals[j], r))).exp()
        w_j = even_norm(w[j][0], r) + w[j][1]
        slope_of_E = even_norm([two_pi * i * x for i, x in enumerate(residuals[j][0])], r)
        slope_of_E += residuals[j][1] / (e * rho)
        y = two_pi * n_j * w_j
        second = k_j * (arb("0.5") + y / 6) * y.exp() * y**2
        errors.append(slope_of_E * w_j + abs(kappa[j]) / two_pi * second)
        slope_of_v = n_j * w_j / (e * rho / 50)
        n.append(n_j + slope_of_v)
        p.append(neumann(p_j, p_j * slope_of_v))
        k.append(k_j * y.exp())
        moved.append(w_j)
        waves.append(k_j)
    narrow = rho * 49 / 50
    holds, constants = conclusion(kappa, narrow, divisors, period, errors, n, p, k)
    before = {
        "error": [even_norm(modes, r) + rest for modes, rest in residuals],
        "n": [even_norm(modes, r) for modes, _ in slopes],
        "p": [even_norm(modes, r) + rest for modes, rest in inverses],
        "k": waves,
        "w": moved,
    }
    largest = {name: float(reduce(arb.max, sites).upper()) for name, sites in before.items()}
    return holds, constants | largest


def mirrored(modes: list[Ball]) -> list[Ball]:
    """Return the modes -K, …, K, given those with k ≥ 0."""
    return modes[:0:-1] + modes


def even_norm(modes: list[Ball], r: Ball) -> Ball:
    """Return Σ_k a_|k| r^|k|."""
    return real_norm(arb_poly(modes), r)


def lebesgue(n: int) -> Ball:
    """Return the Lebesgue constant of interpolation at n Chebyshev points."""
    if n == 1:
        return arb(1)
    return sum((arb(2 * i + 1) / (4 * n)).cot_pi() for i in range(n)) / n


def sizes(f: Any) -> arb_poly:
    """Return the polynomial whose coefficients are the absolute values of those of f."""
    return arb_poly([abs(x) for x in f])


def real_norm(sizes: arb_poly, r: Ball) -> Ball:
    """Return Σ_k a_|k| r^|k|, where the a_k are the coefficients of `sizes`."""
    return 2 * sizes(r) - sizes[0]


def slope(f: Any) -> list[Ball]:
    """Return the modes of g_j' = 1 + u_j'."""
    half = [acb(1), *(acb(0, 2 * arb.pi() * i) * x for i, x in enumerate(f) if i)]
    return [x.conjugate() for x in half[:0:-1]] + half


class Grid:
    """n points of φ at which sin 2πg_j is evaluated, for one forcing at a time.

    n > 2K, where K is the highest mode of the u_j. A mode and its aliases k + n, k + 2n, … appear
    as their sum. Each mode |k| ≥ n/2 counts twice in the error: it is omitted, and it is an alias
    of a mode of smaller weight. If ‖sin 2πg_j‖ ≤ M for ρ̂ > ρ, both errors together are at most
    2M e^{-2π(ρ̂-ρ)n/2}.

    sizes : for each j a polynomial whose coefficients bound |û_k|, k ≥ 0.
    """

    def __init__(self, rho: Ball, sizes: list[Any], wide: float = 1.5) -> None:
        two_pi = 2 * arb.pi()
        self.half = 1 << int(wide * max(map(len, sizes))).bit_length()
        self.r, self.missed = (two_pi * rho).exp(), []
        for f in sizes:
            tries = [rho * (1 + arb(i) / 4) for i in range(1, 60)]
            logs = [
                two_pi * (hat + 2 * f((two_pi * hat).exp()) + (rho - hat) * self.half)
                for hat in tries
            ]
            self.missed.append(2 * min(logs, key=lambda x: float(x.upper())).exp())
        self.angles = [arb(i) / self.half for i in range(2 * self.half)]

    def residuals(self, kappa: list[Ball], u: list[Any], alpha: Ball) -> list[Ball]:
        """Bound ‖E_j‖; u contains, for each j, the polynomial of the modes û_k, k ≥ 0."""
        half, two_pi = self.half, 2 * arb.pi()
        self.modes, self.rests = [], []
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
            self.modes.append([abs(x) for x in E])
            self.rests.append(abs(strength) / two_pi * self.missed[j])
        known = [even_norm(row, self.r) for row in self.modes]
        return [norm + missed for norm, missed in zip(known, self.rests, strict=True)]


def half_modes(re: list[int], im: list[int], unit: Ball) -> acb_poly:
    """Return the modes k ≥ 0 of a real function as the coefficients of a polynomial."""
    length = max(len(re), len(im))
    re, im = ([*part, *[0] * (length - len(part))] for part in (re, im))
    demand(not im[:1] or im[0] == 0, "a function is not real")
    return acb_poly([acb(a * unit, b * unit) for a, b in zip(re, im, strict=True)])


def at_points(
    moves: dict[tuple[int, int], list[Any]], points: tuple[int, int]
) -> Iterator[tuple[Ball, Ball, list[Any]]]:
    """Yield the angles of σ and t, and the functions u_j, at each Chebyshev point."""
    for angle in [arb(2 * i + 1) / (2 * points[0]) for i in range(points[0])]:
        rows: dict[int, list[Any]] = {}  # Σ_m C_jml T_m(σ), by l
        for (m, degree), functions in moves.items():
            before = rows.get(degree, [acb_poly()] * len(functions))
            T = (m * angle).cos_pi()
            rows[degree] = [a + f * T for a, f in zip(before, functions, strict=True)]
        for beside in [arb(2 * i + 1) / (2 * points[1]) for i in range(points[1])]:
            terms = [[f * (m * beside).cos_pi() for f in row] for m, row in rows.items()]
            yield angle, beside, [sum(column, acb_poly()) for column in zip(*terms, strict=True)]


def main() -> None:
    """Check the certificates in the files named on the command line, and print their claims.

    A file contains one certificate or a list of them, as JSON, which may be compressed by xz.
    """
    for path in sys.argv[1:]:
        data = Path(path).read_bytes()
        content = json.loads(lzma.decompress(data) if data.startswith(b"\xfd7zXZ") else data)
        for certificate in content if isinstance(content, list) else [content]:
            try:
                print(f"{path}: proved: {check(certificate)}")
            except Refuted as reason:
                sys.exit(f"{path}: refuted: {reason}")


if __name__ == "__main__":
    main()
