"""Chandrupatla's root finder against SciPy's Brent, and at its edges."""

from math import exp, inf, log, nan, sinh

import pytest
from scipy.optimize import brentq

from nasm.roots import root

FUNCTIONS = [
    lambda x: sinh(3 * (x - 0.3)) * (1 + x * x),
    lambda x: log((x + 1e-3) / 0.2),
    lambda x: exp(9 * x) - exp(8.1),
    lambda x: -100.0 if x < 0.2 else (x - 0.4) * (1 + x),
    lambda x: x - 0.7 + 10 * (x - 0.7) ** 3,
]


@pytest.mark.parametrize("f", FUNCTIONS)
@pytest.mark.parametrize("bracket", [(0.0, 1.0), (1.0, 0.0)])
def test_the_root_is_brent_s_in_fewer_calls(f, bracket):
    calls = []
    found = root(lambda x: calls.append(x) or f(x), *bracket, 1e-10)
    exact, brent = brentq(f, 0.0, 1.0, xtol=1e-10, full_output=True)
    assert abs(found - exact) < 2e-10
    assert len(calls) < 1.3 * brent.function_calls


def test_a_root_at_an_end_is_found():
    assert root(lambda x: x, 0.0, 1.0, 1e-9) == 0
    assert root(lambda x: x - 1, 0.0, 1.0, 1e-9) == 1


@pytest.mark.parametrize("f", [lambda x: 1.0, lambda x: nan, lambda x: -inf])
def test_no_change_of_sign_is_refused(f):
    with pytest.raises(ValueError, match="does not change sign"):
        root(f, 0.0, 1.0, 1e-9)
