import ast
import re
import time
from fractions import Fraction
from itertools import islice, pairwise
from pathlib import Path

import mpmath
import numpy as np
import oracles
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import nasm
from nasm import barriers, circles, continuation, flux, fourier, parameterization, periodic
from nasm.numbers import (
    NAMES,
    RotationNumber,
    convergents,
    moebius,
    nobles_near,
    parse,
    rational,
)
from nasm.symmetries import shorten

quotients = st.integers(1, 30)
prefixes = st.builds(
    lambda a, rest: [a, *rest], st.integers(-5, 5), st.lists(quotients, max_size=5)
)
tails = st.lists(quotients, min_size=1, max_size=5)
irrationals = st.builds(lambda prefix, tail: parse(spell(prefix, tail)), prefixes, tails)
integers = st.integers(-6, 6)


def spell(prefix, tail=()):
    first, *rest = prefix
    period = [f"({','.join(map(str, tail))})"] if tail else []
    parts = [*map(str, rest), *period]
    return f"[{first};{','.join(parts)}]" if parts else f"[{first}]"


def exact(omega):
    """Its value to 100 digits."""
    with mpmath.workdps(100):
        return oracles.continued_fraction(omega.prefix, omega.tail)


def formulas():
    with mpmath.workdps(100):
        gamma = (mpmath.sqrt(5) - 1) / 2
        return {
            "gamma": gamma,
            "gamma+1": gamma + 1,
            "2gamma": 2 * gamma,
            "2gamma+1": 2 * gamma + 1,
            "(5gamma+6)/(4gamma+5)": (5 * gamma + 6) / (4 * gamma + 5),
            "(gamma+1)/(4gamma+5)": (gamma + 1) / (4 * gamma + 5),
        }


def test_the_paper_s_numbers_are_their_formulas():
    assert set(NAMES) == set(formulas())
    for name, value in formulas().items():
        assert float(parse(name)) == oracles.nearest_float(value)


def test_the_paper_s_numbers_as_continued_fractions():
    expected = ["[0;(1)]", "[1;(1)]", "[1;(4)]", "[2;(4)]", "[1;4,(1)]", "[0;4,(1)]"]
    assert [str(parse(name)) for name in NAMES] == expected
    assert [parse(text) for text in expected] == [parse(name) for name in NAMES]


def test_nobles_end_in_ones():
    noble = [parse(name).is_noble for name in NAMES]
    assert noble == [True, True, False, False, True, True]
    assert not parse("3/5").is_noble


@given(prefix=prefixes, tail=tails)
def test_parsing_keeps_the_value(prefix, tail):
    omega = parse(spell(prefix, tail))
    with mpmath.workdps(100):
        value = oracles.continued_fraction(prefix, tail)
    assert mpmath.almosteq(exact(omega), value, rel_eps=mpmath.mpf(10) ** -90)
    assert float(omega) == oracles.nearest_float(value)


@given(prefix=prefixes, tail=tails | st.just([]))
def test_parse_reads_what_str_writes(prefix, tail):
    omega = parse(spell(prefix, tail))
    assert parse(str(omega)) == omega


@given(prefix=prefixes, tail=tails, unrolled=st.integers(0, 7), repeated=st.integers(1, 3))
def test_equal_numbers_compare_equal(prefix, tail, unrolled, repeated):
    turns = (tail * (unrolled + 1))[:unrolled]
    start = unrolled % len(tail)
    rolled = (tail[start:] + tail[:start]) * repeated
    assert parse(spell(prefix + turns, rolled)) == parse(spell(prefix, tail))


@given(st.fractions(max_denominator=10**12))
def test_a_fraction_is_the_last_of_its_convergents(fraction):
    omega = rational(fraction)
    assert list(convergents(omega))[-1] == fraction
    assert float(omega) == float(fraction)
    assert omega.is_rational
    assert omega == parse(str(fraction)) == parse(str(omega))


@given(prefix=prefixes)
def test_the_two_spellings_of_a_fraction_are_one_number(prefix):
    assert parse(spell([*prefix, 1])) == parse(spell([*prefix[:-1], prefix[-1] + 1]))


def test_convergents_of_the_golden_mean_are_ratios_of_fibonacci_numbers():
    ratios = [Fraction(*pair) for pair in [(0, 1), (1, 1), (1, 2), (2, 3), (3, 5), (5, 8), (8, 13)]]
    assert list(islice(convergents(parse("gamma")), 7)) == ratios


@given(irrationals)
def test_convergents_come_ever_closer_from_both_sides(omega):
    value = exact(omega)
    with mpmath.workdps(100):
        misses = [f.denominator * value - f.numerator for f in islice(convergents(omega), 12)]
    assert all(abs(after) < abs(before) for before, after in pairwise(misses))
    assert all(miss * (-1) ** k > 0 for k, miss in enumerate(misses))


def test_no_fraction_with_a_smaller_denominator_is_closer_than_a_convergent():
    omega = float(parse("[0;4,(1)]"))
    for fraction in islice(convergents(parse("[0;4,(1)]")), 1, 9):
        miss = abs(fraction.denominator * omega - fraction.numerator)
        for q in range(1, fraction.denominator):
            assert abs(q * omega - round(q * omega)) > miss


@given(omega=irrationals, a=integers, b=integers, c=integers, d=integers)
def test_moebius_transform_and_its_inverse(omega, a, b, c, d):
    assume(a * d != b * c)
    image = moebius(omega, a, b, c, d)
    assert moebius(image, d, -b, -c, a) == omega
    assert all(quotient >= 1 for quotient in (*image.prefix[1:], *image.tail))
    with mpmath.workdps(100):
        value = exact(omega)
        value = (a * value + b) / (c * value + d)
    assert float(image) == oracles.nearest_float(value)


@given(fraction=st.fractions(max_denominator=50), a=integers, b=integers, c=integers, d=integers)
def test_moebius_transform_of_a_fraction(fraction, a, b, c, d):
    assume(a * d != b * c and c * fraction + d != 0)
    image = rational((a * fraction + b) / (c * fraction + d))
    assert moebius(rational(fraction), a, b, c, d) == image


def test_the_mirror_of_a_circle_has_2_minus_omega():
    assert moebius(parse("2gamma"), -1, 2) == parse("2-2gamma")
    assert moebius(parse("gamma"), -1, 2) == parse("-gamma+2")


def test_moebius_refuses_a_constant_and_infinity():
    with pytest.raises(ValueError, match="does not depend on ω; use ad ≠ bc"):
        moebius(parse("gamma"), 2, 4, 1, 2)
    with pytest.raises(ValueError, match="is infinite at ω = 1/2"):
        moebius(parse("1/2"), 1, 0, 2, -1)


@pytest.mark.parametrize(
    ("text", "omega"),
    [
        ("γ", RotationNumber((0,), (1,))),
        (" 2 * gamma + 1 ", RotationNumber((2,), (4,))),
        ("1 + gamma", RotationNumber((1,), (1,))),
        ("1/gamma", RotationNumber((1,), (1,))),
        ("(2gamma)/(gamma)", RotationNumber((2,))),
        ("-3/5", RotationNumber((-1, 2, 2))),
        ("6/4", RotationNumber((1, 2))),
        ("[3]", RotationNumber((3,))),
        ("[-2; 3, (1, 2)]", RotationNumber((-2, 3), (1, 2))),
    ],
)
def test_ways_to_write_a_number(text, omega):
    assert parse(text) == omega


@pytest.mark.parametrize(
    "text",
    [
        "",
        "golden",
        "1.5",
        "3/0",
        "1/2/3",
        "[1;0,(1)]",
        "[1;2",
        "[;1]",
        "[1;-2]",
        "[1;(0)]",
        "[1;()]",
        "[1;4,,3]",
        "[1;]",
        "gamma*2",
        "gamma2",
        "gamma+1/2",
        "1/4gamma+5",
        "gamma+",
        "(gamma+1",
        "--1",
        "1 2",
        "+",
    ],
)
def test_what_is_not_a_number_is_refused_with_the_forms_that_are(text):
    with pytest.raises(ValueError, match=r"is not a rotation number.*\[1;4,\(1\)\].*5gamma\+6"):
        parse(text)


@pytest.mark.parametrize(
    "text",
    [
        "10000019gamma",
        f"{'7' * 4000}gamma",
        f"(gamma+1)/({'7' * 90}gamma+5)",
        f"[0;{'7' * 5000},(1)]",
        f"3/{'7' * 5000}",
        f"[0;{','.join(['1', '2'] * 10**4)}]",
    ],
)
def test_a_number_that_is_too_long_is_refused_at_once(text):
    begin = time.process_time()
    with pytest.raises(ValueError, match=r"too long; write .* at most 100 digits.* at most 1000 p"):
        parse(text)
    assert time.process_time() - begin < 0.5


def test_long_numbers_below_the_limit_are_read():
    long = parse("2003gamma")
    assert len(long.tail) == 818
    assert parse(str(long)) == long
    assert parse(f"1/{'7' * 100}").prefix == (0, int("7" * 100))


@pytest.mark.parametrize("value", [None, 0.6, True, b"gamma"])
def test_what_is_not_even_text_is_refused_alike(value):
    with pytest.raises(ValueError, match=r"is not a rotation number.*\[1;4,\(1\)\]"):
        parse(value)


def test_arguments_that_would_make_no_number_are_named():
    gamma = parse("gamma")
    with pytest.raises(ValueError, match=r"\(1ω \+ 0\.5\)/\(0ω \+ 1\) is not exact; use whole"):
        moebius(gamma, 1, 0.5)
    for value in (float("nan"), float("inf")):
        with pytest.raises(ValueError, match=rf"value={value} must be finite"):
            nobles_near(value, 1e-3, 2)
    for width in (0.0, -1.0, float("nan")):
        with pytest.raises(ValueError, match=rf"width={width} positive"):
            nobles_near(0.6, width, 2)
    with pytest.raises(ValueError, match=r"value='0\.6' must be a number"):
        nobles_near("0.6", 1e-3, 2)
    with pytest.raises(ValueError, match=r"n=1\.5 must be a whole number from 0"):
        nobles_near(0.6, 1e-3, 1.5)


@pytest.mark.parametrize("integer", [np.int64, np.int8])
def test_integers_of_limited_length_do_not_overflow(integer):
    # Products of 63 bits or more occur on the way.
    expected = moebius(parse("[0;9999,9999,(7,5)]"), 3, 100, 7, 100)
    found = moebius(parse("[0;9999,9999,(7,5)]"), *map(integer, (3, 100, 7, 100)))
    assert found == expected


@given(prefixes, st.integers(-12, -3))
def test_a_noble_is_found_from_its_float(prefix, exponent):
    omega = parse(spell(prefix, [1]))
    found = nobles_near(float(omega), 10.0**exponent, 30)
    assert omega in found
    assert omega == min(found, key=lambda noble: abs(float(noble) - float(omega)))


@given(st.floats(-3, 3), st.floats(1e-9, 0.5), st.integers(1, 6))
def test_nobles_near_a_number_agree_with_it_and_the_shortest_come_first(value, width, n):
    found = nobles_near(value, width, n)
    assert len(set(found)) == len(found) <= n
    lengths = [len(omega.prefix) for omega in found]
    assert lengths == sorted(lengths)
    more = nobles_near(value, width, n + 5)
    assert more[: len(found)] == found
    assert len(found) == n or more == found
    quotients_of_value = rational(Fraction(value)).prefix
    for omega in found:
        assert omega.is_noble
        assert abs(exact(omega) - value) < width * (1 + 1e-6)
        assert omega.prefix == quotients_of_value[: len(omega.prefix)]


@pytest.mark.parametrize(
    ("value", "width", "n", "expected"),
    [
        (0.618034, 1e-5, 1, ["gamma"]),
        (-0.381966, 1e-5, 1, ["gamma-1"]),
        (0.7236, 2e-5, 1, ["[0;1,2,(1)]"]),
        (2.2360679775, 1e-9, 1, ["2gamma+1"]),
        (0.5, 0.2, 9, ["gamma", "1-gamma"]),
        (0.5, 0.1, 9, []),
        (2.0, 0.7, 9, ["2+gamma"]),
        (0.7236, 2e-5, 0, []),
    ],
)
def test_nobles_near_some_numbers(value, width, n, expected):
    found = nobles_near(value, width, n)
    if value == 2.2360679775:  # 2γ + 1 has a tail of fours: the nobles near it are others
        assert found
        assert parse(expected[0]) not in found
        assert found[0].prefix[:5] == (2, 4, 4, 4, 4)
    else:
        assert found == [parse(name) for name in expected]


KAPPA = (0.3, 0.4)
REST = np.zeros((2, 64))  # deviations of the rotation
TAKE_OMEGA = {
    barriers.per_period: (np.array(KAPPA), np.array(KAPPA), rational(0)),
    circles.invariant_circle: (KAPPA,),
    circles.settle: (np.array(KAPPA), REST, 64),
    circles.certify: (np.array(KAPPA), REST),
    circles.polish: (np.array(KAPPA), REST),
    circles.polished_is_circle: (np.array(KAPPA), REST),
    circles.newton_step: (KAPPA, REST),
    circles.residual: (KAPPA, REST),
    continuation.critical_scale: (KAPPA,),
    continuation.certified_scale: (KAPPA, 1.7, 0.1),
    continuation.certified_circle: (KAPPA, 1.7, 0.1),
    flux.flux: (KAPPA,),
    fourier.turns: (8,),
    fourier.grid: (8,),
    fourier.cut: (64,),
    fourier.smallest_divisor: (8,),
    moebius: (1, 1),
    parameterization.newton_step: (KAPPA, REST),
    periodic.critical_scale: (KAPPA,),
    periodic.crossings: (KAPPA,),
}


def test_every_public_function_of_omega_is_among_these():
    found = {
        f"{path.stem}.{node.name}"
        for path in Path(nasm.__file__).parent.glob("*.py")
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
        if [argument.arg for argument in node.args.args][:1] == ["omega"]
    }
    named = {f"{f.__module__.split('.')[1]}.{f.__name__}" for f in TAKE_OMEGA}
    # A torus is named by fractions, no_answer passes on what it gets, the others are tested below.
    others = {"critical.no_answer", "numbers.checked", "numbers.convergents"}
    assert found == named | others | {"periodic.torus_scale"}


@pytest.mark.parametrize("omega", [0.618, "gamma", Fraction(3, 5), None])
@pytest.mark.parametrize(
    ("function", "others"), TAKE_OMEGA.items(), ids=lambda f: getattr(f, "__qualname__", "")
)
def test_what_is_no_rotation_number_is_refused_with_the_remedy(function, others, omega):
    named = re.escape(f"omega={omega!r} is not a RotationNumber")
    with pytest.raises(ValueError, match=named) as refused:
        function(omega, *others)
    assert "nasm.numbers.parse('gamma')" in str(refused.value)


@pytest.mark.parametrize("take", [lambda x: shorten([(0.3,)], x), lambda x: next(convergents(x))])
def test_so_it_is_by_those_of_another_signature(take):
    with pytest.raises(ValueError, match=r"omega=0\.618 is not a RotationNumber"):
        take(0.618)
