"""Lifetimes of invariant graphs in ramps, and the conclusions that the command `ramp` draws."""

import numpy as np
import pytest
import xarray as xr
from oracles import KAPPA_G

from nasm import flux
from nasm.numbers import parse
from workflows.ramp import study


@pytest.mark.parametrize(("rate", "ratio"), [(1e-2, 1.0), (1e-3, 1.0), (1e-6, 0.77)])
def test_lifetimes_are_as_renormalisation_predicts_except_in_slow_ramps(rate, ratio):
    predicted = 1.67 * rate**-study.EXPONENT
    assert study.lost(KAPPA_G, rate) == pytest.approx(ratio * predicted, rel=0.05)


@pytest.mark.parametrize("rate", [1e-3, 1e-5])
def test_the_first_crossing_occurs_at_a_total_flux_between_0_1_and_0_5(rate):
    """The flux grows like (κ - κ_G)^3.01, so its sum is its final value times kicks/4.01."""
    kicks = study._escape(KAPPA_G + rate * np.arange(int(6 * rate**-study.ESCAPES)))
    end = flux.flux(parse("gamma"), (KAPPA_G + rate * kicks,)).value
    assert 0.1 < end * kicks / 4.01 < 0.5


def test_the_shapes_have_the_properties_that_their_names_promise():
    shapes = study._shapes(np.arange(1000))
    assert list(shapes["Thue-Morse"][:8]) == [1, -1, -1, 1, -1, 1, 1, -1]
    letters = "".join(np.where(shapes["Fibonacci"] > 0, "a", "b"))
    assert "bb" not in letters
    assert "aaa" not in letters
    for shape in shapes.values():
        assert 0.9 < np.abs(shape).max() <= 1


@pytest.mark.parametrize(
    ("exponents", "jumps", "smooth", "expected"),
    [
        ((0.497, 0.751), 90.0, np.inf, ["Supported: "] * 3),
        ((0.45, 0.7), 90.0, 900.0, ["caveat:"] * 2 + ["Not supported:"]),
        ((0.33, 0.9), np.inf, np.inf, ["Not supported:"] * 3),
    ],
)
def test_the_numbers_can_refute_the_claims_of_the_command(exponents, jumps, smooth, expected):
    rate = 10.0 ** -np.arange(2, 7)
    lost, through = (rate**-a * (1 + 0.01 * np.array([1, -1, 1, -1, 1])) for a in exponents)
    ramp = {"lost": ("rate", lost), "escaped": ("rate", through)}
    kind = xr.DataArray([*study.SMOOTH, *study.JUMPS], dims="kind")
    lives = xr.Dataset(coords={"kind": kind, "ripple": [0.1]}, attrs={"kicks": 3000})
    lives["life"] = lives["escaped"] = ("kind", "ripple"), 4 * [[smooth]] + 4 * [[jumps]]
    *lines, _ = study.findings(xr.Dataset(ramp, {"rate": rate}), lives).splitlines()
    assert [words in line for words, line in zip(expected, lines, strict=True)] == [True] * 3
