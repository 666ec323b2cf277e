"""Proofs of transport: bounds on errors, certificates, and forcings where nothing is proved."""

import inspect
import json
import math
import platform
import re
from fractions import Fraction
from functools import partial
from itertools import count
from types import FunctionType, SimpleNamespace

import audit
import numpy as np
import pytest
from cases import thirds
from flint import arb, arb_poly, ctx, fmpq

from nasm import barriers, proofs
from nasm.arithmetic.sine import COSINE, SINE
from nasm.converse_kam import symmetry_line
from nasm.proofs import certificate_checker as checker
from nasm.proofs.transport import Outcome, prove, proved_upper
from nasm.symmetries import ray

# Scales at which the last circle breaks, from `barriers.critical_scale`; no proof relies on them.
BREAKUPS = {0: 0.4858177030, 20: 0.5770384095, 30: 0.7001827090, 45: 1.3740999690}

# A forcing without symmetry, 4% beyond CB_gt as found by residues.
SEVERAL = tuple(1.04 * 0.40238460723838 * np.array([1.0, 0.7, 0.3]))


def beyond(angle, excess):
    return BREAKUPS[angle] * (1 + excess) * ray(angle)


def of_rounding(coefficients, u):
    """Bound the error of Horner's rule with fma at v = u² (rounded); also return the value."""
    ulp, v = arb(2) ** -53, u * u
    value, error = coefficients[-1], arb(0)
    for c in coefficients[-2::-1]:
        error = error * (1 + ulp) * v + (abs(value) + error) * ulp * v
        value = value * v + c
        error += ulp * (abs(value) + error)
    return error, value


def worst_error(polynomial, series, is_odd, pieces=8192):
    """Bound |computed - exact| of Σ c_k u²ᵏ (times u if `is_odd`) on 0 ≤ u ≤ 1/4.

    The polynomial minus the series is a polynomial; its mean-value form bounds it on each piece.
    u = 1/4 - |r| has an error of at most 2⁻⁵⁶, and is exact for |r| ≥ 1/8.
    """
    ulp, tail = arb(2) ** -53, arb(10) ** -40  # the series' next term is below 10⁻⁵⁰
    difference, worst = arb_poly(polynomial) - arb_poly(series), 0.0
    slope = difference.derivative()  # with respect to v
    for i in range(pieces):
        middle, radius = fmpq(2 * i + 1, 8 * pieces), fmpq(1, 8 * pieces)
        u, middle = arb(middle, radius), arb(middle)
        approximation = abs(difference(middle**2)) + tail
        approximation += abs(2 * u * slope(u * u)) * arb(radius)
        error, value = of_rounding(polynomial, u)
        if is_odd:
            approximation, error = approximation * u, error * u + ulp * (abs(value * u) + error * u)
        total = approximation + error + arb(2) ** -56 * (1 if is_odd else 2 * arb.pi())
        worst = max(worst, float(total.upper()))
    return worst


def test_bounds_of_sine_and_cosine_hold_over_the_whole_range():
    ctx.prec, terms = 200, range(24)
    powers = [(-1) ** k * (2 * arb.pi()) ** (2 * k) for k in terms]
    h = [power / math.factorial(2 * k + 1) for k, power in enumerate(powers)]
    cosine = [power / math.factorial(2 * k) for k, power in enumerate(powers)]
    of_h, of_cosine = ([arb(c) for c in coefficients] for coefficients in (SINE, COSINE))
    # The worst errors are 0.864·2⁻⁵³ and 2.02e-14.
    assert 0.8 * 2**-53 < worst_error(of_h, h, True) < 0.87 * 2**-53 < proofs.transport.ULP
    assert 1.9e-14 < worst_error(of_cosine, cosine, False) < 2.03e-14 < proofs.transport.COS


def error_of_accurate_sine(middle, radius, series):
    """Bound the error |h + h_low - sin 2πx/2π| of `_accurate` for u = 1/4 - |r| in a ball.

    An error-free operation yields a float, and a remainder of at most 2⁻⁵³ times the float. The
    bound is the sum of all rounding errors and omitted terms.
    """
    ulp, u = arb(2) ** -53, arb(middle, radius)
    u_low = arb(2) ** -56
    v, v_low = u * u, ulp * u * u + 2 * u * u_low
    v_error = ulp * v_low + u_low**2
    floats = [arb(c) for c in proofs.transport._S4]
    s, error = floats[-1], abs(floats[-1] - series[11])
    for k in range(10, 3, -1):
        error = error * v + abs(s) * v_low + abs(floats[k - 4] - series[k])
        s = s * v + floats[k - 4]
        error += ulp * (abs(s) + error)
    s_low = arb(0)
    for k in (3, 2, 1, 0):
        high, low = map(arb, getattr(proofs.transport, f"_S{k}"))
        product = abs(s) * v * (1 + ulp)
        assert abs(high) > product  # so that their sum is split exactly
        first = abs(s) * v_low + ulp * product
        second = s_low * v + first
        third = second * (1 + ulp) + abs(low)
        error = error * (v + v_low) + abs(s) * v_error + s_low * v_low + abs(high + low - series[k])
        s = s * v + high
        fourth = ulp * abs(s) * (1 + ulp) + third * (1 + ulp)
        error += ulp * (first + second + third + fourth)
        s_low = fourth * (1 + ulp)
    low = ulp * u * abs(s) + u * s_low
    error = error * (u + u_low) + ulp * low + u_low * s_low + ulp * (low + u_low * abs(s))
    # Add the next term of the series, the error of cos, and the square of x_low (≤ 2⁻⁵⁴).
    error += (2 * arb.pi() * u) ** 24 / math.factorial(25) * u
    return error + ulp * (low + 2 * ulp) + arb(proofs.transport.COS) * ulp + 4 * ulp**2


def test_bound_of_the_accurate_sine_holds_over_the_whole_range():
    ctx.prec, pieces = 200, 1024
    series = [(-1) ** k * (2 * arb.pi()) ** (2 * k) / math.factorial(2 * k + 1) for k in range(12)]
    worst = max(
        float(error_of_accurate_sine(middle, fmpq(1, 8 * pieces), series).upper())
        for middle in (fmpq(2 * i + 1, 8 * pieces) for i in range(pieces))
    )
    # In the kick, products and sums of low parts add a few times 2⁻¹⁰⁴.
    assert 2.0**-69 < worst < proofs.transport.ORBIT - 2.0**-90


STATE = ("x", "x_low", "y", "y_low", *"vwVWtzqpAB", "linear", "quadratic", "rest", "paid")
KERNEL = audit.Kernel(
    functions=tuple(
        getattr(proofs.transport, name) for name in ("horner", "_accurate", "_next", "_kick")
    ),
    names=STATE,
    known=(("t", "z", "linear"), ("q", "p", "quadratic")),
    places=((-1.0,), (1.0,), (0.5,)),
    rounding=(0.33 * 2.0**-66, 0.0),  # as bounded by the test above
)


def exact_fma(a, b, c):
    return float(Fraction(a) * Fraction(b) + Fraction(c))


LINE = np.array([[0.5, 0.0], [0.5, 0.5]])


def start(points, s, delta, slope, way):
    """Return the state with which the kernel starts a box, and the inverse of its Wronskian."""
    lanes = np.zeros((proofs.transport._ROWS, 1))
    proofs.transport._start(lanes, 0, points, s, delta, slope, way)
    *state, scale = lanes[:, 0].tolist()
    return state, scale


def test_both_directions_of_a_box_start_at_its_place_on_the_polygon():
    random = np.random.default_rng(2)
    for _ in range(40):
        points = np.rint(random.uniform(-1, 1, (4, 2)) * 2.0**26) / 2.0**26
        delta = 2.0 ** -int(random.integers(3, 50))
        s = delta * (2 * int(random.integers(0, 0.75 / delta)) + 1)
        slope = float(random.integers(-3 * 2**20, 2**20)) / 2**20
        piece, states = int(2 * s), [start(points, s, delta, slope, way)[0] for way in (0, 1)]
        (x, y), (x_end, y_end) = (map(Fraction, point) for point in points[piece : piece + 2])
        part = 2 * Fraction(s) - piece
        x, y, t, z = x + part * (x_end - x), y + part * (y_end - y), x_end - x, y_end - y
        ahead, behind = (dict(zip(STATE, map(Fraction, state), strict=True)) for state in states)
        assert ahead["x"] + ahead["x_low"] + Fraction(1, 4) == x
        assert behind["x"] + behind["x_low"] + Fraction(1, 4) == y - x  # -x_{c-1}
        for state in (ahead, behind):
            assert state["y"] + state["y_low"] == y
        for state, moved in ((ahead, t), (behind, z - t)):
            sign = 1 if state["z"] * z > 0 else -1
            assert (state["t"], state["z"]) == (2 * delta * sign * moved, 2 * delta * sign * z)
        # η is 1 at the site, and both directions use the same η at the site before it.
        assert ahead["V"] == 1 == behind["V"] - behind["W"]
        assert ahead["V"] - ahead["W"] == behind["V"] == 1 - Fraction(slope)


def test_the_error_bounds_of_a_kick_hold_and_are_sharp_to_10_percent():
    shares = audit.audit_of_kicks(KERNEL)
    assert all(0.9 < share <= 1 for share in shares.values())


CHANGES = {
    "payments are halved": ("due / V", "0.5 * due / V"),
    "payments are written up": ("paid = paid + due", "paid = paid + 1.01 * due"),
    "half the linear sum": ("maximum(0.0, (fabs(linear)", "maximum(0.0, (0.5 * fabs(linear)"),
    "no quadratic sum": ("maximum(0.0, quadratic)", "0.0"),
    "quadratic sum of the wrong sign": ("-(TWO_PI2 * kc) * t", "TWO_PI2 * kc * t"),
    "no rest": (" + rest) * UP - paid", ") * UP - paid"),
    "cosine: ρ left out": ("fma(TWO_PI * sine, unknown, ", "("),
    "cosine: square left out": ("fma(TWO_PI2 * cosine, both, ", "("),
    "κh'' too small": ("f2 = -TWO_PI2 * k", "f2 = -0.99 * TWO_PI2 * k"),
    "q without its source": ("fma(f2 * t, t, fma(kc, q, p))", "fma(kc, q, p)"),
    "κ cos of the wrong sign": ("kc = k * c", "kc = -k * c"),
    "a shorter polynomial": ("s = horner(v, _S4)", "s = horner(v, (*_S4[:6], 0.0, 0.0))"),
    "a coefficient rounded": ("v, v_low, _S1)", "v, v_low, (_S1[0], 0.0))"),
    "low parts are lost": ("error + (x_low + y_low)", "error"),
    "nothing along v": ("fma(defect, straight, A)", "A"),
    "nothing along t": ("fma(defect, fabs(v), B)", "B"),
    "q left out of |x - x̂|": ("fabs(q) + unknown", "unknown"),
    "no 1.002": ("(1.002 * scale)", "scale"),
    "payments are not more than records": (" + due / V * PAYMENT_FACTOR", " + due / V"),
    "what is due is not rounded up": ("+ rest) * UP - paid", "+ rest) - paid"),
    "rounding: a twentieth": ("fma(E, 1e-12, 3e-14)", "fma(E, 0.05e-12, 0.15e-14)"),
    "orbit: a tenth": ("(size + 1.0) * ORBIT", "(size + 1.0) * 0.1 * ORBIT"),
    "no fourth power": ("QUARTIC * E2 * E2", "0.0"),
    "half the cube": ("CUBIC * cosine", "0.5 * CUBIC * cosine"),
    "a cube of 6.57": ("CUBIC * cosine", "6.57 * cosine"),
    "cosine: half the cube": ("COS_CUBIC * E3", "0.5 * COS_CUBIC * E3"),
    "rounding of sums": (" + 1e-15 * signed", ""),
    "square: without E": ("curved * (E + straight)", "curved * straight"),
    "half the square": ("curved * (E + straight)", "0.5 * curved * (E + straight)"),
    "solutions: error of cos": ("fma(E2, 41.0, E) * (size * (COS + 4 * ULP))", "0.0"),
    "solutions: 1 for 3.1": ("3.1 * ULP", "1.0 * ULP"),
    "error of the sine": ("fma(fabs(h), TWO_PI, 7e-16)", "fabs(h) * TWO_PI"),
    "a box of any size": ("maximum(0.0, E - _MAX_DEVIATION)", "0.0"),
    "a Wronskian of any size": ("+ maximum(0.0, wronskian - _MAX_WRONSKIAN_ERROR)", ""),
    "a Wronskian that is not rounded": ("+ fabs(tv) * (4", "- fabs(tv) * (4"),
}


@pytest.mark.alters_sources
@pytest.mark.parametrize("change", thirds(CHANGES))
def test_a_changed_line_is_noticed(change):
    assert max(audit.audit_of_kicks(KERNEL, change).values()) > 1


def test_lanes_and_floats_agree_with_the_source_run_in_python():
    kick = audit.in_python(KERNEL.functions, fma=exact_fma)
    proof = prove(beyond(20, 0.1))
    result = zip(proof.boxes.tolist(), proof.slopes, strict=True)
    boxes = [(proof.points, *box, slope, way) for box, slope in result for way in (0, 1)][:16]
    cycle = np.tile(np.roll(proof.kappa, -proof.site), proofs.transport._KICKS_PER_BLOCK // 2)
    lanes, events = np.zeros((proofs.transport._ROWS, 16)), np.empty((2, 16))
    for lane, box in enumerate(boxes):
        proofs.transport._start(lanes, lane, *box)
    replayed = [proofs.transport._replay(cycle, lanes, lane) for lane in range(16)]
    proofs.transport._advance(cycle, lanes, events)
    for lane in (0, 5, 11, 15):
        state, scale = start(*boxes[lane])
        smallest, worst, life = 1.0, 0.0, None
        for n, k in enumerate(cycle.tolist()):
            state, bad, _ = kick(k, scale, state)
            smallest, worst = min(smallest, state[STATE.index("V")]), worst + bad
            if life is None and (bad > 0 or state[STATE.index("V")] <= 0):
                life = n + 1, int(bad > 0)
        assert lanes[:, lane].tolist() == [*state, scale]
        assert events[:, lane].tolist() == [smallest, worst]
        assert replayed[lane] == (
            life or (proofs.transport._KICKS_PER_BLOCK, proofs.transport._FAILED)
        )


def test_compiled_code_fuses_exactly_the_operations_written_as_fma():
    # Compile `_replay` and `_advance` here, instead of loading them from the cache.
    after_a_block(STATE.index("x"), 0.25)
    sources = {f.__name__: inspect.getsource(f.py_func) for f in KERNEL.functions}
    source = "".join(sources.values())
    written = source.count("fma(") + sum(
        (source.count(f"{name}(") - 2) * sources[name].count("fma(") for name in ("horner", "_next")
    )
    functions = (
        (proofs.transport._replay, "double", 1),
        (proofs.transport._advance, "<16 x double>", 16),
    )
    for function, kind, width in functions:
        (code,), (assembly,) = function.inspect_llvm().values(), function.inspect_asm().values()
        calls = len(re.findall(rf"call {kind} @llvm\.fma", code))
        assert calls > 0
        assert calls % written == 0
        flags = re.findall(rf"= f(?:add|sub|mul|div) (.*){kind}", code)
        assert len(flags) > 80
        assert not any(flags)  # there is no `fast`, `contract` or other flag
        fused = re.findall(r"\tvfn?m(?:add|sub)\w+([sp])d\t.*%([xyz])mm", assembly)
        if platform.machine() == "x86_64" and fused:
            widths = {"sx": 1, "px": 2, "py": 4, "pz": 8}
            assert sum(widths["".join(one)] for one in fused) == calls * width


def test_nothing_is_proved_with_arithmetic_that_is_not_ieee_754(monkeypatch):
    assert proofs.transport._arithmetic_is_ieee(1.0, 2.0**-53, 2.0**-52, 2.0**-1022)
    # These values would result on machines that truncate or that lack gradual underflow.
    assert not proofs.transport._arithmetic_is_ieee(1.0, 2.0**-52, 2.0**-52, 2.0**-1022)
    assert not proofs.transport._arithmetic_is_ieee(1.0, 2.0**-53, 2.0**-52, 2.0**-1074)
    monkeypatch.setattr(proofs.transport, "_arithmetic_is_ieee", lambda *_: False)
    with pytest.raises(RuntimeError, match="IEEE 754"):
        prove((2.5,))


class Rounded:
    """A number of 53 bits, rounded by a function such as `math.floor`."""

    def __init__(self, exact, way):
        digits = exact.numerator.bit_length() - exact.denominator.bit_length()
        unit = Fraction(2) ** (digits - 52)
        self.exact, self.way = way(exact / unit) * unit, way

    def __add__(self, other):
        return Rounded(self.exact + other.exact, self.way)

    def __mul__(self, other):
        factor = other.exact if isinstance(other, Rounded) else Fraction(other)
        return Rounded(self.exact * factor, self.way)

    __rmul__ = __mul__

    def __truediv__(self, other):
        return self * (1 / other)

    def __neg__(self):
        return Rounded(-self.exact, self.way)

    def __sub__(self, other):
        return self + -other

    def __eq__(self, other):
        return self.exact == other.exact

    def __gt__(self, other):
        return self.exact > other


@pytest.mark.parametrize("way", [round, math.floor, math.ceil, math.trunc])
def test_only_rounding_to_nearest_with_a_fused_fma_is_accepted(way):
    numbers = [Rounded(Fraction(2) ** i, way) for i in (0, -53, -52, -1022)]
    for fma, fused in (
        (lambda a, b, c: Rounded(a.exact * b.exact + c.exact, way), True),
        (lambda a, b, c: a * b + c, False),
    ):
        code = proofs.transport._arithmetic_is_ieee.py_func.__code__
        accepted = FunctionType(code, {"fma": fma})(*numbers)
        assert accepted == (way is round and fused)


def after_a_block(row, value, kappa=(1.5, 1.2)):
    """Return the outcome of a box with one number changed, and whether the lanes report an event.

    Without the change, the box is eliminated within the block.
    """
    lanes, events = np.zeros((proofs.transport._ROWS, 16)), np.empty((2, 16))
    for lane in range(16):
        proofs.transport._start(lanes, lane, LINE, 0.3, 1e-3, kappa[0] / 2, 0)
    lanes[row, 0] = value
    cycle = np.tile(kappa, proofs.transport._KICKS_PER_BLOCK // 2)
    _, outcome = proofs.transport._replay(cycle, lanes, 0)
    proofs.transport._advance(cycle, lanes, events)
    return outcome, not (events[0, 0] > 0 and events[1, 0] <= 0)


@pytest.mark.parametrize("row", range(proofs.transport._ROWS))
def test_a_box_with_overflow_or_nan_is_not_eliminated(row):
    assert after_a_block(STATE.index("x"), 0.25) == (proofs.transport._ELIMINATED, True)
    values = [math.nan]
    if STATE[row : row + 1] != ("paid",):
        values.append(math.inf)  # paid becomes infinite only after V
    if STATE[row : row + 1] == ("V",):
        values.append(1e160)  # its square overflows
    for value in values:
        assert after_a_block(row, value) == (proofs.transport._FAILED, True)


@pytest.mark.parametrize("off", [0.998, 1.002, 1.5])
def test_a_box_with_an_inaccurate_wronskian_is_not_eliminated(off):
    start_of_scale = 1 / (1e-3 * 2 * 0.5)
    scale = len(STATE)
    assert after_a_block(scale, start_of_scale) == (proofs.transport._ELIMINATED, True)
    assert after_a_block(scale, off * start_of_scale) == (proofs.transport._FAILED, True)


@pytest.mark.parametrize(("kappa", "budget", "kicks"), [(63 / 64, 0.5, 50_000), (0.9718, 5, 10**9)])
def test_results_of_mackay_percival_1985_and_jungreis_1991_are_confirmed(kappa, budget, kicks):
    """The standard map has no circle at 63/64 (proved in a millisecond) or at 0.9718."""
    proof = prove((kappa,), budget)
    assert proof.proved
    assert proof.lifetimes.sum() < kicks
    if kappa > 0.98:
        checker.check(json.loads(json.dumps(proof.certificate())))


SIGNS = (1, 1), (-1, 1), (1, -1)


@pytest.mark.parametrize(
    ("angle", "excess", "all_signs"),
    [
        *((0, 0.1, SIGNS), (20, 0.1, SIGNS), (30, 0.03, SIGNS), (45, 0.03, SIGNS)),
        pytest.param(45, 1e-3, SIGNS[2:], marks=pytest.mark.slow),
        pytest.param(45, 1e-3, SIGNS[:2], marks=pytest.mark.release),
    ],
)
def test_an_independent_program_accepts_the_certificate(angle, excess, all_signs):
    for signs in all_signs:
        proof = prove(signs * beyond(angle, excess)[::-1])
        assert proof.proved
        checker.check(json.loads(json.dumps(proof.certificate())))


def test_a_lifetime_shorter_than_the_true_one_is_refused():
    """A start in the box is known to survive longer than the lifetime that is checked."""
    proof = prove(beyond(30, 0.1))
    kappa = np.roll(proof.kappa, -proof.site)
    refused = 0
    for (y, delta), life in zip(proof.boxes, proof.lifetimes[:, 0], strict=True):
        starts = [y + place * delta for place in (-1, 0, 1)]
        lived = len(kappa) * max(symmetry_line.elimination_time(kappa, starts, 10**4))
        assert lived <= life
        if lived > 1:
            strengths = [Fraction(number) for k in kappa.tolist() for number in (k, 0)]
            box = (Fraction(y), Fraction(delta), *strengths)
            assert not checker.second_variation(Fraction(proof.a), box, int(lived) - 1) <= 0
            refused += 1
    assert refused > 30


def test_boxes_tile_the_half_line():
    proof = prove(beyond(45, 0.03))
    assert proofs.transport._tiles(proof.boxes)
    for i in range(len(proof.boxes)):
        assert not proofs.transport._tiles(np.delete(proof.boxes, i, axis=0))


def test_both_ends_of_a_polygon_are_fixed_by_a_reflection():
    corners = np.array([[0.5 + 2.0**-20, -(2.0**-21)], [0.3, 0.2], [0.51, 1.49]])
    points, pieces = proofs.transport._closed(corners)
    assert (2 * points[[0, -1]] == [[1, 0], [1, 3]]).all()
    assert points[1:-1] == pytest.approx(corners, abs=2.0**-27)
    assert pieces == [-1, 0, 1, 2]


def test_a_lifetime_beyond_the_allowance_for_rounding_raises_an_error(monkeypatch):
    monkeypatch.setattr(proofs.transport, "_MAX_LIFETIME", 5)
    with pytest.raises(RuntimeError, match="a lifetime of 5 kicks"):
        prove(beyond(20, 0.1))


@pytest.mark.parametrize(
    "kappa", [(2.0, 2.5), (-2.0, 5.0), (3, 1, 2, 1), (0.7, 0.5, 0.7, 0.7, 0.5)]
)
def test_nothing_is_proved_for_forcings_outside_the_theorem(kappa):
    assert prove(kappa).outcome is Outcome.SCOPE


def test_more_kicks_than_transversals_allow_are_outside_the_theorem():
    assert prove(1e-4 * np.linspace(1, 2, 65)).outcome is Outcome.SCOPE


@pytest.mark.parametrize("kappa", [(0.0,), (0.04, 0.0), (1e-300, 5e-324, 1e-310)])
def test_no_proof_is_attempted_where_a_circle_obviously_exists(kappa, monkeypatch):
    monkeypatch.setattr(proofs.transport, "_covered", None)
    monkeypatch.setattr(proofs.transport.transversal, "eliminated_transversals", None)
    assert prove(kappa).outcome is Outcome.WEAK


def test_the_search_for_a_polygon_ends_when_the_budget_is_spent(monkeypatch):
    # The clock advances whenever it is read. A circle exists, so the search would take minutes
    # without a limit.
    clock = SimpleNamespace(thread_time=partial(next, count(0, 0.1)))
    searches, bend = proofs.transport.transversal, proofs.transport.transversal.Transversal.bend
    bends = []

    def counted(*arguments):
        bends.append(arguments)
        return bend(*arguments)

    proofs.transport._compile_search()
    monkeypatch.setattr(proofs.transport, "time", clock)
    monkeypatch.setattr(searches, "time", clock)
    monkeypatch.setattr(searches.Transversal, "bend", counted)
    assert prove((0.3, 0.2, 0.1), budget=0.8).outcome is Outcome.BUDGET
    assert 0 < len(bends) < 10


@pytest.mark.parametrize("kappa", [(1e6,), (1e6, 1.9), (2.0,), (2.0, 0.0), (np.nextafter(2, 3),)])
def test_transport_under_strong_kicks_is_proved_at_once(kappa):
    proof = prove(kappa)
    assert proof.proved
    assert proof.lifetimes.sum() < 3000


def test_below_the_breakup_nothing_is_proved():
    for angle in BREAKUPS:
        for excess in (-1e-1, -1e-3, -1e-6):
            assert not prove(beyond(angle, excess), 0.02).proved
    assert not prove((0.0,), 0.02).proved


@pytest.mark.parametrize("n_rays", [
    pytest.param(20, marks=pytest.mark.slow),
    pytest.param(40, marks=pytest.mark.release),
])  # fmt: skip
def test_below_the_breakup_of_random_rays_nothing_is_proved(n_rays):
    random = np.random.default_rng(17)
    for angle in random.uniform(0, 45, n_rays):
        value = barriers.critical_scale(ray(angle), 1e-3).value
        for excess in 10.0 ** random.uniform(-6, -1, 10):
            kappa = random.permutation(value * (1 - excess) * ray(angle))
            kappa *= random.choice([-1, 1], 2)
            assert not prove(kappa, 0.1).proved, kappa


def test_proved_upper_is_above_the_breakup_and_near_it_for_any_estimate():
    proved_upper(ray(20), BREAKUPS[20], 0.01)  # compile the kernels
    scale, proof = proved_upper(ray(20), BREAKUPS[20], 0.5)
    assert proof.proved
    assert proof.kappa == tuple((scale * ray(20)).tolist())
    assert 0 < scale / BREAKUPS[20] - 1 < 1e-3
    scale, proof = proved_upper(ray(20), 0.3, 0.5)
    assert proof.proved
    assert BREAKUPS[20] < scale < 0.8
    assert math.isnan(proved_upper((1.0, 0.8, 1.0, 1.0, 0.8), 0.65, 0.1)[0])


def tried(profile, excess, checks):
    """Attempt a proof beyond the breakup found by `barriers`, then below it; return the first.

    Below the breakup nothing may be proved, on the polygon of the first proof or on any other.
    """
    result = barriers.critical_scale(profile, 1e-3)
    proof = prove((1 + excess) * result.upper * np.array(profile))
    for scale in (0.9 * result.lower, result.lower) if proof.proved else ():
        kappa = 2 * (tuple((scale * np.array(profile)).tolist()),)
        below, _ = proofs.transport._covered(*kappa, proof.site, proof.points, 0.2)
        assert not below.proved
        assert below.lifetimes.size > 0  # boxes on edges that no circle crosses are eliminated
    assert not prove(0.9 * result.lower * np.array(profile), 0.2).proved
    if checks and proof.proved:
        checker.check(json.loads(json.dumps(proof.certificate())))
    return proof


@pytest.mark.parametrize("profile", thirds([(1, 0.7, 0.3), (0.4, 1, 0.4), (1, 1, -1, -1)]))
def test_transport_under_several_kicks_is_proved_only_beyond_the_breakup(profile):
    assert tried(profile, 0.05, True).proved


_RANDOM = np.random.default_rng(8)
RANDOM = [_RANDOM.uniform(-1, 1, n) for n in (3, 3, 3, 3, 4, 4, 4, 5, 5, 6, 6, 8)]
RANDOM += np.array([0.838, 0.654, 0.771]), np.array([-0.064, -0.015, -0.444, -0.504])


@pytest.mark.parametrize("profiles", [
    pytest.param(RANDOM[::-2], id="every second", marks=pytest.mark.slow),
    pytest.param(RANDOM[-2::-2], id="the others", marks=pytest.mark.release),
])  # fmt: skip
def test_transport_under_random_kicks_is_proved_only_beyond_the_breakup(profiles):
    """Proofs are attempted 1% beyond the breakup.

    One profile is close to a multiple of (0, 0, 1, 1); its polygon nearly follows the longest-lived
    starts.
    """
    results = [tried(profile, 0.01, profile.size < 5) for profile in profiles]
    assert all(proof.proved and len(proof.boxes) < 5000 for proof in results)
