"""Grids and cuts between the resonances of ω. More of `fourier` is in test_circles.py."""

from itertools import islice

import pytest
from cases import irrationals
from hypothesis import given, settings
from hypothesis import strategies as st

from nasm.circles import fourier
from nasm.numbers import NAMES, RotationNumber, convergents, parse


@settings(max_examples=300)
@given(irrationals, st.integers(1, 30_000))
def test_a_grid_keeps_the_modes_asked_for_and_ends_below_a_resonance(omega, n_modes):
    n = fourier.grid(omega, n_modes)
    kept = fourier.cut(omega, n)
    assert kept >= n_modes
    assert kept in {f.denominator for f in islice(convergents(omega), 60)}
    assert kept < 0.361 * n  # room for products


@pytest.mark.parametrize("name", NAMES)
def test_a_grid_is_no_larger_than_the_next_resonance_asks_for(name):
    omega = parse(name)
    for n_modes in (100, 1000, 20_000):
        q = next(f.denominator for f in convergents(omega) if f.denominator >= n_modes)
        assert fourier.cut(omega, fourier.grid(omega, n_modes)) == q
        assert q / 0.36 < fourier.grid(omega, n_modes) < 1.2 * q / 0.36


def test_a_cut_between_two_resonances_that_are_close_is_below_both():
    omega = RotationNumber((0, 4, 30), (1,))  # 121 and 125
    assert fourier.cut(omega, 350) == 121
    assert fourier.cut(omega, fourier.grid(omega, 121)) == 121
    assert fourier.cut(omega, fourier.grid(omega, 122)) >= 122
