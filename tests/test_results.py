"""Results can be compared, even if they contain arrays or NaN, and they print readably."""

import copy
import pickle

import numpy as np
import pytest

from nasm import circles, periodic, planes, self_consistent
from nasm.converse_kam.transversal import Transversal
from nasm.diffusion import Diffusion
from nasm.flux import Flux
from nasm.manifolds import Turnstile
from nasm.numbers import parse
from nasm.results import CriticalScale, Status, no_answer
from nasm.verdicts import verdict

GAMMA = parse("gamma")

MADE = {
    "verdict of a barrier": (lambda kappa: verdict((kappa,)), 0.3, 0.31),
    "verdict of transport": (lambda kappa: verdict((kappa,)), 2.0, 2.1),
    "circle": (lambda kappa: circles.invariant_circle("gamma", (kappa,)), 0.3, 0.31),
    "no circle": (lambda kappa: circles.invariant_circle("gamma", (kappa,)), 3.0, 3.1),
    "scale": (lambda kappa: periodic.critical_scale("gamma", (kappa,), 300), 0.3, 0.31),
    "no scale": (lambda nan: CriticalScale(*[nan] * 4, None, Status.NO_CIRCLE), np.nan, 1.0),
    "self-consistent kicks": (lambda x: self_consistent.evolve([x], [0.1], 0.1, 0.1, 3), 0.3, 0.4),
    "plane": (planes.three_kicks, 0.3, 0.31),
    "flux": (lambda value: Flux(value, np.nan, 8, GAMMA, Status.OK), np.nan, 1.0),
    "diffusion": (lambda value: Diffusion(value, np.nan, Status.OK), np.nan, 1.0),
}


@pytest.mark.parametrize("name", MADE)
def test_results_are_equal_if_all_their_fields_are_equal(name):
    make, number, another = MADE[name]
    one = make(number)
    for other in (make(number), copy.copy(one), pickle.loads(pickle.dumps(one))):
        assert one is not other
        assert one == other
    assert one != make(another)
    assert one != 1


def test_planes_and_critical_scales_are_hashable():
    assert len({planes.two_kicks(), planes.two_kicks(), planes.three_kicks(0.1)}) == 2
    nothing = [no_answer(None, Status.RATIONAL) for _ in range(2)]
    assert len({*nothing, CriticalScale(1, 0, 0, 2, None, Status.OK)}) == 2


def test_transversals_that_contain_arrays_are_compared_without_an_error():
    one, other = (Transversal(0, np.array([0.3, 0.2, 0.4]), [], float) for _ in range(2))
    assert one == one
    assert one != other


def test_a_critical_scale_prints_the_digits_that_its_error_justifies():
    result = CriticalScale(
        0.97163540631, 2.13e-8, 0.9715431, 0.9717168, GAMMA, Status.OK, "residues"
    )
    expected = (
        "CriticalScale(0.971635406 ± 2.1e-08, bracket [0.97154, 0.97172], "
        "circle [0;(1)] = 0.618034 per period, method: residues, OK)"
    )
    assert repr(result) == str(result) == expected


def test_a_critical_scale_without_a_value_prints_the_reason_and_a_remedy():
    text = repr(no_answer(None, Status.NO_CIRCLE))
    assert text == f"CriticalScale(no value, NO_CIRCLE: {Status.NO_CIRCLE.value})"
    one_end = CriticalScale(np.nan, np.nan, np.nan, 1.25, None, Status.NOT_CONVERGED)
    assert "no value, upper 1.25, NOT_CONVERGED" in repr(one_end)


@pytest.mark.parametrize("value", [1e-300, 1e300, 0.0, -2.0, 12345.6])
def test_critical_scales_of_any_magnitude_can_be_printed(value):
    for error in (0.0, 1e-3, np.inf, np.nan, 1e300):
        assert "CriticalScale(" in repr(CriticalScale(value, error, value, value, None, Status.OK))


def test_a_notebook_shows_a_critical_scale_as_a_table():
    html = CriticalScale(0.5, 0.01, np.nan, 0.6, GAMMA, Status.OK, "a < b")._repr_html_()
    assert html.startswith("<table>")
    for cell in "0.500 ± 0.01", "none is found at 0.6", "[0;(1)] = 0.61803398875 per period":
        assert f"<td>{cell}</td>" in html
    assert "<td>a &lt; b</td>" in html
    assert "a circle exists" not in html


NO_VALUE = Diffusion(np.nan, np.nan, Status.ANOMALOUS)
RECORD = self_consistent.evolve([0.25], [0.1], 0.0, 0.5, 3)
PRINTED = [  # a result, the line it prints, and a cell of its table
    (
        Flux(3.7312e-5, 2.1e-9, 610, GAMMA, Status.OK),
        "Flux(3.73120e-05 ± 2.1e-09 per step, orbits of period 610, circle [0;(1)], OK)",
        "[0;(1)] = 0.61803398875 per step",
    ),
    (
        Diffusion(0.52314, 0.0123, Status.OK),
        "Diffusion(0.523 ± 0.012 per period, OK)",
        "0.523 ± 0.012 per period",
    ),
    (NO_VALUE, f"Diffusion(no value, ANOMALOUS: {Status.ANOMALOUS.value})", "no value"),
    (
        Turnstile(0.25, (np.zeros((2, 3)), np.zeros((2, 5)))),
        "<Turnstile: lobes of area 0.25, with 3 and 5 points>",
        "3 and 5",
    ),
    (RECORD, "<Record: 3 kicks, 1 particles; at the end κ = 0.5, θ = 0 turns>", "0.5 to 0.5"),
]


@pytest.mark.parametrize(("found", "line", "cell"), PRINTED)
def test_a_result_prints_on_one_line_and_as_a_table(found, line, cell):
    assert repr(found) == line
    assert f"<td>{cell}</td>" in found._repr_html_()


@pytest.mark.parametrize("status", [one for one in Status if one is not Status.OK])
def test_a_status_names_the_reason_and_a_remedy(status):
    reason, cure = status.value.split("; ")
    assert reason
    assert cure
