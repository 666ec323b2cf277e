"""Strings from untrusted sources are parsed promptly, or rejected with a one-sentence message."""

import signal
from decimal import Decimal
from fractions import Fraction
from functools import partial

import click
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nasm import checks, numbers, planes, texts
from pipeline.sweep.grid import parse_axis
from workflows.circle_boundaries import parse_omega
from workflows.explore.rays import named_by
from workflows.explore.state import State, orbits_of
from workflows.frequencies import parse_frequency
from workflows.shared.cli import main_of
from workflows.shared.forcing_files import numbers_in

DIGITS = "9" * 60_000


@pytest.fixture(autouse=True)
def alarm():
    """Make a test fail if it hangs."""

    def hangs(*_):
        raise TimeoutError("a string took more than 60 s to parse")

    before = signal.signal(signal.SIGALRM, hangs)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def visit(name, text):
    """Open the explorer at an address whose parameter `name` is `text`."""
    State(planes.two_kicks()).go({name: text})


def option(command, name, text):
    """Parse an option of a command."""
    return main_of(command).make_context(command, [f"{name}={text}"])


FRACTION = "is not a fraction; write one like 3/8 or 0.375, with at most 100 digits"
STORED = '{"name": "plane", "axes": {}, "origin": [%s, 0], "first": [1, 0], "second": [0, 1]}'


@pytest.mark.parametrize(
    ("read", "text", "message"),
    [
        (partial(visit, "pq"), "1e-99999999", "'1e-99999999' must be a fraction like 3/8"),
        (partial(visit, "pq"), "1e99999999", "'1e99999999' must be a fraction like 3/8"),
        (partial(visit, "pq"), f"1/{DIGITS}", "(60004 characters) must be a fraction like 3/8"),
        (partial(visit, "omega"), f"1{' ' * 60_000}1", "too long; write at most 10000 characters"),
        (partial(visit, "omega"), f"[0;{','.join(['9' * 99] * 600)}]", "too long; write at most"),
        (partial(visit, "omega"), DIGITS + ".5", "must be below 1e+06; write one like 0.618"),
        (partial(visit, "n"), DIGITS, "must be a whole number from 100 to 1000000"),
        (partial(visit, "k1"), "x" * 60_000, "is not a number; write one like 0.3"),
        (partial(visit, "orbits"), "0,0;" * 15_000, "orbits: 15000 is too many"),
        (partial(visit, "show"), DIGITS, "must be a list of names from boundary"),
        (partial(visit, "a"), DIGITS, "must be a range, like 0.1:0.3"),
        (partial(visit, "plane"), DIGITS, "start another with --plane 9999"),
        (orbits_of, f"0 {'9 ' * 60_000}", "must be two numbers, like 0.5, 0.3"),
        (planes.parse, "rotating:1e-99999999,0", f"frequency='1e-99999999' {FRACTION}"),
        (planes.parse, f"rotating:1/3,{DIGITS}/7", FRACTION),
        (planes.parse, "three-kicks:1e999", f"third='1e999' {FRACTION}"),
        (planes.parse, DIGITS, "is not a plane; write two-kicks"),
        (planes.from_json, STORED % DIGITS, "kappa=[inf, 0.0] is not finite or too large"),
        (planes.from_json, "[" * 60_000, "must be a JSON object with the keys name"),
        (numbers.rational, "1e-99999999", f"'1e-99999999' {FRACTION}"),
        (numbers.rational, Decimal("1e-99999999"), f"'1E-99999999' {FRACTION}"),
        (named_by, f"3/{'7' * 99}", "is rational, and has no circle"),
        (parse_omega, f"[0;{','.join(['9' * 99] * 60)}]", "is rational, so no"),
        (parse_frequency, "1e-99999999", "'1e-99999999' must be a frequency above 0, at most 1/2"),
        (parse_frequency, f"1/{DIGITS}", FRACTION),
        (parse_axis, f"0:1:{DIGITS}", "is not an axis; write LO:HI:N"),
        (partial(option, "escape_plane", "--plane"), "rotating:1e-99999999", FRACTION),
        (
            partial(option, "escape_plane", "--n-max"),
            DIGITS,
            "whole number from 1 to 1000000000000",
        ),
        (partial(option, "escape_plane", "--n-orbits"), DIGITS, "increasing whole numbers from 1"),
        (partial(option, "last_barrier", "--tol"), DIGITS, "must be a number from 1e-05 to 0.1"),
        (partial(option, "last_barrier", "--tol"), "x" * 60_000, "is not a number"),
        (numbers_in, DIGITS.encode() + b"x", "is not a number; write one like 0.3"),
        (numbers_in, DIGITS.encode() + b",0", "may be one number or two"),
        (partial(checks.count, "n", low=1, high=5), 10**5000, "must be a whole number from 1 to 5"),
    ],
    ids=lambda value: (
        "" if callable(value) else repr(value)[:20] if isinstance(value, str | bytes) else ""
    ),
)
def test_oversized_or_malformed_input_is_refused_at_once_in_one_sentence(read, text, message):
    with pytest.raises((ValueError, click.BadParameter)) as refused:
        read(text)
    output = str(refused.value)
    assert message in output
    assert len(output) < 300
    assert "\n" not in output


@pytest.mark.parametrize("text", ["0.3819660112501051", "0.5" + 30 * "0", "0." + DIGITS])
@pytest.mark.parametrize("whole", ["", "-", "12345"])
def test_digits_of_a_decimal_number_beyond_float_precision_are_ignored(text, whole):
    noble, _ = named_by(whole + text)
    assert float(numbers.parse(noble)) == pytest.approx(float(whole + text), rel=1e-14)


def test_numbers_in_a_file_may_have_any_number_of_digits():
    assert numbers_in(DIGITS.encode()) == [float("inf")]


@given(st.fractions(max_denominator=10**30), st.sampled_from(["{}", " {}\n"]))
def test_parsing_a_formatted_fraction_returns_the_same_value(value, form):
    assert texts.parse_fraction(form.format(value)) == value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("-0.375", Fraction(-3, 8)),
        (".5", Fraction(1, 2)),
        ("3.", 3),
        ("-1e-3", Fraction(-1, 1000)),
        ("2.5E+2", 250),
        ("7" * 100 + "/" + "9" * 100, Fraction(int("7" * 100), int("9" * 100))),
    ],
)
def test_decimal_numbers_are_parsed_exactly(text, value):
    assert texts.parse_fraction(text) == checks.exact_fraction(text) == value


@pytest.mark.parametrize("text", ["", "x", "nan", "inf", "1/0", "1/-2", "3 / 8", "1_0", "1e1000"])
def test_a_string_that_is_not_a_fraction_is_refused(text):
    with pytest.raises(ValueError, match=FRACTION):
        texts.parse_fraction(text)
