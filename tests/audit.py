"""Audits of the proof programs: copies with changed lines, and checks that must detect them."""

import ast
import inspect
import math
import re
import sys
import types
from dataclasses import dataclass
from functools import cache
from itertools import combinations_with_replacement
from itertools import product as outcomes

import numpy as np
import pytest
from flint import arb, ctx, fmpq
from numba import njit

from nasm.arithmetic.double_double import renormalised, two_sum
from nasm.arithmetic.lanes import fma


def changed(source, changes):
    """Return the source with `right` replaced by `wrong` for each of the changes (right, wrong).

    Each `right` must match in exactly one place. White space is ignored, so a line may be
    wrapped differently.
    """
    for right, wrong in changes:
        tokens = re.findall(r"\w+|[^\w\s]", right)
        pattern = r"\s*".join(map(re.escape, tokens))
        source, n_changes = re.subn(pattern, lambda _, wrong=wrong: wrong, source)
        if n_changes != 1:
            raise LookupError(
                f"{right!r} matches in {n_changes} places: a table of changes is out of date"
            )
    return source


def mutant(module, *changes):
    """Return a copy of a module, executed from its source after the changes."""
    other = types.ModuleType("mutant")
    with pytest.MonkeyPatch.context() as patch:  # restores only this key, and keeps other imports
        patch.setitem(sys.modules, "mutant", other)  # dataclasses look the module up there
        exec(changed(inspect.getsource(module), changes), vars(other))
    return other


ULP, COS_ERROR = 2.0**-53, 2.03e-14  # bounds on rounding errors and the error of cos 2πx (tested)
LONGEST = 1e11  # maximum lifetime of a box, in kicks


@njit
def fused(a, b, c):
    """Compute ab + c on floats with a single rounding."""
    return fma(a, b, c)


def in_python(functions, *changes, fma=fused):
    """Return the last of `functions` as plain Python on floats, after changes to the sources.

    Calling it returns the values of the kernel, followed by a dict of all its variables.
    """
    source = "".join(inspect.getsource(function.py_func) for function in functions)
    program = ast.parse(changed(source, changes))
    for definition in program.body:
        definition.decorator_list = []
    for node in ast.walk(program.body[-1]):
        if isinstance(node, ast.Return):
            values = f"(*({ast.unparse(node.value)}), locals())"
            node.value = ast.parse(values, mode="eval").body
    namespace = {}
    for function in functions:
        namespace |= vars(sys.modules[function.py_func.__module__])
    namespace |= {"fma": fma, "rint": lambda a: float(round(a)), "fabs": abs}
    namespace |= {"copysign": math.copysign, "maximum": lambda a, b: a if a > b else b}
    namespace |= {"two_sum": two_sum.py_func, "renormalised": renormalised.py_func}
    exec(compile(ast.fix_missing_locations(program), "kernels", "exec"), namespace)
    return namespace[functions[-1].py_func.__name__]


@dataclass(frozen=True)
class Kernel:
    """Properties of a kernel that the audits use.

    functions : the last one applies one kick; it calls the others. names : names of the numbers in
    a state. known : for each term of the known displacement of an orbit, Σ factor·displacement, the
    names of the displacement, of its last difference, and of its sum in Q. The factors are the
    parameters and then their products. places : the orbits to be tested in a box, as (σ,) or, for
    cells, (σ, σ_0, σ_1). rounding : bound on the rounding error of x̂ in one kick, as (coefficient
    of |κ|, constant).
    """

    functions: tuple
    names: tuple[str, ...]
    known: tuple[tuple[str, str, str], ...]
    places: tuple[tuple[float, ...], ...]
    rounding: tuple[float, float]

    @property
    def cells(self):
        return len(self.places[0]) == 3

    def state(self, numbers):
        """Return the numbers of a state by name, as balls."""
        named = dict(zip(self.names, map(arb, numbers), strict=True))
        return {"x_low": arb(0), "y_low": arb(0)} | named

    def factors(self, place):
        place = [arb(x) for x in place]
        return place + [a * b for a, b in combinations_with_replacement(place, 2)]

    def sources(self, state, k, widths, sine, cosine):
        """Return what a kick adds to each last difference, besides κ cos 2πx·displacement."""
        moves = [state[name] for name, *_ in self.known[: len(self.places[0])]]
        widths = [arb(0), *map(arb, widths)]
        squares, mixed = product(moves, moves), product(widths, moves)
        return [width * sine / (2 * arb.pi()) for width in widths] + [
            cosine * other - arb.pi() * k * sine * square
            for square, other in zip(squares, mixed, strict=True)
        ]

    def strength(self, strengths, place):
        """Return κ, or k + σ_α f + σ_β g in cells."""
        widths = zip(strengths[1:3], place[1:], strict=True)
        return strengths[0] + sum((width * arb(x) for width, x in widths), arb(0))

    def largest(self, sums):
        """Return the largest value of Σ factor·sum in a box."""
        return sum(map(abs, sums)) if self.cells else abs(sums[0]) + sums[1].max(arb(0))


def product(f, g):
    """Return the coefficients of the product of two linear forms, in the order of `factors`."""
    pairs = combinations_with_replacement(range(len(f)), 2)
    return [f[i] * g[j] + f[j] * g[i] if i < j else f[i] * g[i] for i, j in pairs]


def combined(factors, state, names):
    return sum((f * state[name] for f, name in zip(factors, names, strict=True)), arb(0))


def used(value, bound):
    """Return value/bound; it exceeds 1 if the value exceeds the bound, even by a single bit."""
    if not bound > 0:
        return math.inf if value > 1e-30 else 0.0
    share = float((value / bound).mid())
    return share if value <= bound else max(share, math.nextafter(1, 2))


def audit_of_a_kick(kernel, kick, strengths, scale, numbers):
    """Check in multiprecision arithmetic that the state after one kick satisfies all bounds.

    strengths : k, and for cells also f, g and `blur`, the largest deviation of the strength from
    k + σ_α f + σ_β g. Returns, by name, the fraction of each bound that is used; it exceeds 1 if
    the bound is too small. For a bad box, these fractions are not computed.

    1. Any orbit in the box satisfies the chain up to a defect; A and B grow by its components.
    2. `rest` grows by whatever may increase Q beyond the sums; the payments cover sums and `rest`.
    3. A box that is too large, or whose Wronskian is no longer accurate, is reported as bad.
    4. The kick changes y and the last differences of all solutions by the right amounts.
    """
    ctx.prec = 256
    state, bad, inner = kick(*strengths, scale, tuple(numbers))
    a, b, k, pi = kernel.state(numbers), kernel.state(state), strengths[0], arb.pi()
    widths, blur = strengths[1:3], arb(strengths[3] if kernel.cells else 0.0)
    spread = sum(map(abs, widths))
    moves, steps, sums = zip(*kernel.known, strict=True)
    wronskian = abs(a["v"] * b["t"] - b["v"] * a["t"])
    E = a["A"] * abs(a["v"]) + a["B"] * abs(a["t"]) + sum(abs(a[name]) for name in moves)
    if E > 0.1 or abs(wronskian * scale - 1) > 1.01e-3 or b["V"] > 1e100:
        return {"bad": math.inf if bad <= 0 else 1.0}
    if not bad <= 0:
        return {}
    X, Y = a["x"] + a["x_low"] + fmpq(1, 4), a["y"] + a["y_low"]
    sine, cosine = (2 * X).sin_cos_pi()
    h, V2 = sine / (2 * pi), a["V"] ** 2
    defect = curved = unseen = more = arb(0)
    for place in kernel.places:
        factors, strength = kernel.factors(place), kernel.strength(strengths, place)
        straight = combined(factors[: len(place)], a, moves[: len(place)])
        known, added = combined(factors, a, moves), combined(factors, b, sums)
        added -= combined(factors, a, sums)
        for sign, off_by in outcomes((1, -1), (-blur, blur) if kernel.cells else (blur,)):
            alpha, beta = sign * a["A"] * a["v"].sgn(), sign * a["B"] * a["t"].sgn()
            moved = known + alpha * a["v"] + beta * a["t"]
            sine_there, cosine_there = (2 * (X + moved)).sin_cos_pi()
            kicked = (strength + off_by) * sine_there / (2 * pi)
            off = X + moved + Y + combined(factors, a, steps) + alpha * a["w"] + beta * a[steps[0]]
            off += kicked - b["x"] - b["x_low"] - fmpq(1, 4) - combined(factors, b, moves)
            off -= alpha * b["v"] + beta * b["t"]
            defect = defect.max(abs(off - round(float(off.mid()))))
            line = strength * h + k * (cosine * moved - pi * sine * straight**2)
            line += (strength - k) * cosine * straight
            curved = curved.max(abs(kicked - line))
            change = (strength + off_by) * cosine_there - k * cosine
            unseen = unseen.max(abs(V2 * change - added))
            line = (strength - k) * (cosine - 2 * pi * sine * straight)
            line -= 2 * pi * k * (sine * known + pi * cosine * straight**2)
            more = more.max(abs(change - line))

    # Worst-case rounding errors in x̂, in the solutions at this site and the next, in cos, in V.
    rounded = a["A"] * (abs(b["w"]) + abs(b["v"]) + abs(a["v"]))
    rounded += a["B"] * (abs(b[steps[0]]) + abs(b["t"]) + abs(a["t"]))
    rounded += sum(abs(a[name]) for name in moves)
    rounded += sum(abs(b[name]) for name in (*moves, *steps))
    sources = kernel.sources(a, k, widths, sine, cosine)
    for step, source in zip(steps, sources, strict=True):
        if source != 0:
            rounded += abs(b[step] - source) + abs(source)
    solutions = ULP * rounded + COS_ERROR * abs(k) * E
    orbit = kernel.rounding[0] * abs(k) + kernel.rounding[1]
    of_strength = spread * COS_ERROR * E
    worst = (curved + solutions + orbit + of_strength).max(defect) * (1 + LONGEST * ULP) / wronskian
    of_V = V2 * ((7 + 4 * abs(k)) * ULP + COS_ERROR * (abs(k) + spread))
    of_sums = 3 * ULP * sum(abs(b[name]) for name in sums)
    needed = kernel.largest([b[name] for name in sums]) + b["rest"]
    payment = a["V"] * (b["W"] - a["W"] - k * cosine * a["V"])
    paid = a["paid"] + payment + of_V
    # Check that the kick has changed y and all last differences by the right amounts.
    turned = b["y"] + b["y_low"] - a["y"] - a["y_low"] - k * h
    right = abs(turned - round(float(turned))) < 1e-15
    changes = zip(("v", *moves), ("w", *steps), (arb(0), *sources), strict=True)
    for move, step, source in changes:
        size = abs(a[step]) + abs(k * a[move]) + abs(source) + (spread + E) * E
        right &= abs(b[step] - a[step] - k * cosine * a[move] - source) < 1e-12 * size
    shares = {
        "steps": 1.0 if right else math.inf,
        "sine": used(abs(sine), arb(inner["sine"])),
        "solutions": used(solutions, arb(inner["solutions"])),
        "A": used(worst * abs(a["t"]), b["A"] - a["A"] + ULP * b["A"]),
        "B": used(worst * abs(a["v"]), b["B"] - a["B"] + ULP * b["B"]),
        "rest": used((V2 * more + of_V + of_sums).max(unseen), b["rest"] - a["rest"]),
        "paid": used(needed, paid),
    }
    record = b["paid"] - a["paid"]
    if kernel.cells:
        shares["records"] = used(b["paid"], paid)
    elif record > 1e-9 * a["paid"]:  # smaller records are lost in the rounding of their sum
        shares["records"] = used(record * (1 + LONGEST * ULP), payment + of_V)
    return shares


def audit_of_kicks(kernel, *changes):
    """Return the largest fraction used of each bound, by name; stop if a bound is too small."""
    kick, largest = in_python(kernel.functions, *changes), {}
    for row in rows(kernel):
        for name, share in audit_of_a_kick(kernel, kick, *row).items():
            largest[name] = max(largest.get(name, 0.0), share)
            if not share <= 1:
                return largest
    return largest


def row_of_the_cube(kernel):
    """Return a row whose defect is mainly cubic and whose Wronskian is the smallest allowed."""
    row = dict.fromkeys(kernel.names, 0.0)
    row |= {"x": -0.25, "y": 0.3, "v": 1.0, "V": 1.0, "t": 1e-4, kernel.known[0][1]: 1e-4}
    strengths = (1.9, 1e-10, 0.0, 0.0) if kernel.cells else (1.9,)
    return strengths, 0.9991e4, [row[name] for name in kernel.names]


@cache
def rows(kernel, count=400):
    """Return rows (strengths, scale, numbers) for kicks that test all parts of the bounds.

    Each part dominates in some of the rows. In some rows, nearly everything due was paid
    before the kick.
    """
    rng, kick = np.random.default_rng(1), in_python(kernel.functions)
    results = [row_of_the_cube(kernel)]

    def size(low, high):
        return float(10 ** rng.uniform(low, high) * rng.choice([-1, 1]))

    for _ in range(count):
        spread = rng.choice([abs(size(-10, 0)), rng.uniform(0, 2)]) if kernel.cells else 0.0
        k = float(rng.choice([0.0, 1.0, rng.uniform()]) * (2 - spread) * rng.choice([-1, 1]))
        # The strength changes with σ_α, with σ_β, or with both.
        f, g = spread * np.array([(1, 0), (0, -1), (-0.5, 0.5)][rng.integers(3)])
        blur = rng.choice([0.0, 4 * ULP * abs(k), abs(size(-14, -3))])
        strengths = (k, float(f), float(g), float(blur)) if kernel.cells else (k,)
        row = dict.fromkeys(kernel.names, 0.0)
        turn = rng.choice([rng.uniform(-0.5, 0.5), rng.integers(-2, 3) / 4 + size(-17, -3)])
        row |= {"x": float(turn - np.rint(turn)), "y": rng.uniform(-0.5, 0.5)}
        row |= {"v": size(-1, 3), "V": abs(size(-1, 2))}
        parts = 10 ** np.append(0, rng.uniform(-9, 0, len(kernel.known) + 1))
        parts = rng.permutation(parts)
        parts[0] = max(parts[0], 0.5)  # otherwise the box is bad
        parts[len(kernel.places[0]) :] *= rng.choice([1.0, abs(size(-9, 0))])
        parts *= rng.choice([abs(size(-18, -1)), 0.09, 0.12], p=[0.9, 0.05, 0.05]) / parts.sum()
        for (move, step, _), part in zip(kernel.known, parts, strict=False):
            row[move] = float(part * rng.choice([-1, 1]))
            row[step] = row[move] * rng.uniform(-3, 1)
        if spread and rng.uniform() < 0.2:  # the kick leaves p unchanged
            h = math.cos(2 * math.pi * row["x"]) / (2 * math.pi)
            row |= {"zp": -f * h, "p": 0.0, "zq": -g * h, "q": 0.0}
        row |= {"A": parts[-1] / abs(row["v"]), "B": parts[-2] / abs(row["t"])}
        row |= {"w": row["v"] * rng.uniform(-2, 2), "W": row["V"] * rng.uniform(-1, 1)}
        step = kernel.known[0][1]
        if rng.uniform() < 0.2:  # v and t are nearly parallel: their Wronskian is inexact
            row[step] = row["w"] * row["t"] / row["v"] * (1 + size(-13, -10))
        wronskian = row["v"] * row[step] - row["w"] * row["t"]
        if wronskian < 0:
            row |= {name: -row[name] for name in ("v", "w")}
        scale = float(1 / abs(wronskian) * rng.choice([1.0, 1.0, 1.0, 1.002]))
        begun = rng.choice([0, 0.5])  # nonzero sums would hide small terms
        for *_, name in kernel.known:
            row[name] = row["V"] ** 2 * size(-8, 8) * float(rng.uniform() < begun)
        row["rest"] = row["V"] ** 2 * abs(size(-12, 0)) * float(rng.choice([0, 1]))
        numbers = [float(row[name]) for name in kernel.names]
        paid = kernel.names.index("paid")
        due = kick(*strengths, scale, tuple(numbers))[0][paid]
        nearly = 1 - abs(size(-17, rng.choice([-13, 0])))
        numbers[paid] = float(due / (1 + 1e-14) * nearly * rng.choice([0, 1]))
        results.append((strengths, scale, numbers))
    return results
