import time
from fractions import Fraction
from itertools import islice, pairwise

import mpmath
import numpy as np
import oracles
import pytest
from cases import irrationals, prefixes, spell, tails
from hypothesis import assume, given
from hypothesis import strategies as st

from nasm.numbers import NAMES, RotationNumber, convergents, moebius, nobles_near, parse, rational

integers = st.integers(-6, 6)


def exact(omega):
    """Return the value of ω to 100 digits."""
    with mpmath.workdps(100):
        return oracles.continued_fraction(omega.prefix, omega.tail)


def test_the_named_numbers_of_the_paper_agree_with_their_formulas():
    expected = ["[0;(1)]", "[1;(1)]", "[1;(4)]", "[2;(4)]", "[1;4,(1)]", "[0;4,(1)]"]
    assert [str(parse(name)) for name in NAMES] == expected
    with mpmath.workdps(100):
        g = (mpmath.sqrt(5) - 1) / 2
        values = g, g + 1, 2 * g, 2 * g + 1, (5 * g + 6) / (4 * g + 5), (g + 1) / (4 * g + 5)
    assert [float(parse(name)) for name in NAMES] == list(map(oracles.nearest_float, values))


@given(prefix=prefixes, tail=tails)
def test_parsing_preserves_the_value_and_inverts_printing(prefix, tail):
    omega = parse(spell(prefix, tail))
    assert parse(str(omega)) == eval(repr(omega), {"parse": parse}) == omega
    with mpmath.workdps(100):
        value = oracles.continued_fraction(prefix, tail)
    assert mpmath.almosteq(exact(omega), value, rel_eps=mpmath.mpf(10) ** -90)
    assert float(omega) == oracles.nearest_float(value)


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
    assert omega == parse(str(fraction)) == parse(str(omega)) == eval(repr(omega))


@given(prefix=prefixes)
def test_both_continued_fractions_of_a_rational_give_the_same_number(prefix):
    assert parse(spell([*prefix, 1])) == parse(spell([*prefix[:-1], prefix[-1] + 1]))


@given(irrationals)
def test_convergents_approach_a_number_from_alternate_sides(omega):
    value = exact(omega)
    with mpmath.workdps(100):
        misses = [f.denominator * value - f.numerator for f in islice(convergents(omega), 12)]
    assert all(abs(after) < abs(before) for before, after in pairwise(misses))
    assert all(miss * (-1) ** k > 0 for k, miss in enumerate(misses))


@given(omega=irrationals, a=integers, b=integers, c=integers, d=integers)
def test_a_moebius_transform_is_undone_by_its_inverse(omega, a, b, c, d):
    assume(a * d != b * c)
    image = moebius(omega, a, b, c, d)
    assert moebius(image, d, -b, -c, a) == omega
    assert all(quotient >= 1 for quotient in (*image.prefix[1:], *image.tail))
    with mpmath.workdps(100):
        value = exact(omega)
        value = (a * value + b) / (c * value + d)
    assert float(image) == oracles.nearest_float(value)


@given(fraction=st.fractions(max_denominator=50), a=integers, b=integers, c=integers, d=integers)
def test_the_moebius_transform_of_a_fraction_is_exact(fraction, a, b, c, d):
    assume(a * d != b * c and c * fraction + d != 0)
    image = rational((a * fraction + b) / (c * fraction + d))
    assert moebius(rational(fraction), a, b, c, d) == image


def test_moebius_refuses_to_return_infinity():
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
def test_a_number_can_be_written_in_several_ways(text, omega):
    assert parse(text) == omega


NO_NUMBERS = "|golden|1.5|3/0|1/2/3|[1;0,(1)]|[1;2|[;1]|[1;-2]|[1;(0)]|[1;()]"
NO_NUMBERS += "|[1;4,,3]|[1;]|gamma*2|gamma2|gamma+1/2|1/4gamma+5|gamma+|(gamma+1|--1|1 2|+"


@pytest.mark.parametrize("text", [*NO_NUMBERS.split("|"), None, 0.6, True, b"gamma"])
def test_invalid_numbers_are_refused_with_examples_of_valid_forms(text):
    with pytest.raises(ValueError, match=r"is not a rotation number.*\[1;4,\(1\)\].*5gamma\+6"):
        parse(text)


TOO_LONG = "10000019gamma", f"{'7' * 4000}gamma", f"(gamma+1)/({'7' * 90}gamma+5)"
TOO_LONG += f"[0;{'7' * 5000},(1)]", f"3/{'7' * 5000}", f"[0;{','.join(['1', '2'] * 10**4)}]"


@pytest.mark.parametrize("text", TOO_LONG)
def test_a_number_that_is_too_long_is_refused_at_once(text):
    begin = time.process_time()
    with pytest.raises(ValueError, match=r"too long; write .* at most 100 digits.* at most 1000 p"):
        parse(text)
    assert time.process_time() - begin < 0.5


def test_long_numbers_below_the_limit_are_parsed():
    long = parse("2003gamma")
    assert len(long.tail) == 818
    assert parse(str(long)) == long
    assert parse(f"1/{'7' * 100}").prefix == (0, int("7" * 100))


@pytest.mark.parametrize("integer", [np.int64, np.int8])
def test_numpy_integers_in_a_moebius_transform_do_not_overflow(integer):
    # Intermediate products have 63 bits or more.
    expected = moebius(parse("[0;9999,9999,(7,5)]"), 3, 100, 7, 100)
    result = moebius(parse("[0;9999,9999,(7,5)]"), *map(integer, (3, 100, 7, 100)))
    assert result == expected


@given(prefixes, st.integers(-12, -3))
def test_a_noble_number_is_identified_from_its_float(prefix, exponent):
    omega = parse(spell(prefix, [1]))
    result = nobles_near(float(omega), 10.0**exponent, 30)
    assert omega in result
    assert omega == min(result, key=lambda noble: abs(float(noble) - float(omega)))


@given(st.floats(-3, 3), st.floats(1e-9, 0.5), st.integers(1, 6))
def test_nobles_near_a_number_share_its_quotients_shortest_first(value, width, n):
    result = nobles_near(value, width, n)
    assert len(set(result)) == len(result) <= n
    lengths = [len(omega.prefix) for omega in result]
    assert lengths == sorted(lengths)
    more = nobles_near(value, width, n + 5)
    assert more[: len(result)] == result
    assert len(result) == n or more == result
    quotients_of_value = rational(Fraction(value)).prefix
    for omega in result:
        assert omega.tail == (1,)
        assert abs(exact(omega) - value) < width * (1 + 1e-6)
        assert omega.prefix == quotients_of_value[: len(omega.prefix)]


@pytest.mark.parametrize("kind", [np.int8, np.uint8, np.int64])
def test_numpy_quotients_give_the_same_number_as_ints_without_overflow(kind):
    rng = np.random.default_rng(0)
    for _ in range(20):
        prefix, tail = rng.integers(1, 30, 6).tolist(), rng.integers(1, 30, 3).tolist()
        of_ints = RotationNumber(tuple(prefix), tuple(tail))
        of_arrays = RotationNumber(np.array(prefix, kind), np.array(tail, kind))
        assert moebius(of_arrays, 1, 1, 2, 3) == moebius(of_ints, 1, 1, 2, 3)
        assert list(islice(convergents(of_arrays), 40)) == list(islice(convergents(of_ints), 40))
        assert float(of_arrays) == float(of_ints)
        assert all(type(a) is int for a in of_arrays.prefix + of_arrays.tail)
    ratio = rational(Fraction(kind(3), kind(8)))
    assert ratio == parse("3/8")
    assert all(type(a) is int for a in ratio.prefix)


@pytest.mark.parametrize(
    "prefix",
    [(), (True,), (0, 2.0), (0, 0), (0, -1), "02", 3, np.ma.array([0, 2], mask=[False, True])],
)
def test_malformed_continued_fractions_are_refused_on_construction(prefix):
    with pytest.raises(ValueError, match="prefix="):
        RotationNumber(prefix)
    with pytest.raises(ValueError, match=r"tail=\(0,\) must be whole numbers, ≥ 1"):
        RotationNumber((1,), (0,))
