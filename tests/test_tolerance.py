"""Ripples and random forcings compared with constant kicks; responses, laws and findings."""

import numpy as np
import pytest
import xarray as xr
from oracles import KAPPA_G

from nasm import barriers, periodic
from nasm.numbers import parse
from pipeline.cubes.forcings import labels, random_climb, scale_without_barrier
from workflows.figures.tolerance import draw_tolerance
from workflows.shared.judgement import span
from workflows.tolerance import response, study

GAMMA = float(parse("gamma"))


def test_responses_of_golden_residues_agree_with_finite_differences():
    """Change all kicks by the same factor, and then by a ripple of period 3.

    Under (1, 1, 1) there is one minimax orbit with ω = 2/3 for each phase. Under the ripple, one of
    these orbits is the minimax over all phases, and periodic.residue returns its residue.
    """
    for n, p, q in ((4, 2, 3), (5, 3, 5), (7, 8, 13)):
        up, down = (periodic.residue((KAPPA_G * (1 + h),), p, q) for h in (1e-5, -1e-5))
        result = response.response(response.orbits(n)[1], np.ones(q))
        assert result == pytest.approx((up - down) / 2e-5, rel=1e-5)
    f, h = study.ripple(3), 1e-6
    phases = [response.response(response.orbits(4)[1], np.roll(f, shift)) for shift in range(3)]
    moved = (periodic.residue(KAPPA_G * (1 + h * f), 2, 1) - periodic.residue((KAPPA_G,), 2, 3)) / h
    assert min(abs(moved - each) for each in phases) < 1e-3 * max(np.abs(phases))


def test_ripples_have_mean_zero_rms_one_and_one_of_three_shapes():
    for shape, d, profile in study.ripples(False):
        assert (profile.mean(), profile.std()) == pytest.approx((1, d))
        assert shape == "cosine" or profile.size in (4, 6, 8)
    assert study.ripple(4, "square") == pytest.approx([1, 1, -1, -1])
    assert study.ripple(4, "one kick") * 3**0.5 == pytest.approx([3, -1, -1, -1])


def test_finer_circles_approach_the_golden_one_and_modes_form_cycles():
    """`finer` maps the golden circle to itself, and other circles to circles closer to it."""
    steps = [len(response.modes(n)) * response.steps(n) for n in study.PERIODS]
    assert steps == [3, 4, 6, 10, 12, 8, 12]
    for n, circle in {2: "[0;1,3,4,2,(1)]", 3: "[1;6,1,5,(1)]", 7: "[2;1,1,3,5,2,(1)]"}.items():
        golden, mode = response.finer(f"{n}gamma", n, 1)
        assert (parse(golden), mode) == (parse(f"{n}gamma"), 1)
        finer, mode = response.finer(circle, n, 1)
        assert (abs(float(parse(finer)) - n * GAMMA) < 1e-2, mode) == (True, 1)


def test_the_measured_and_predicted_laws_of_alternating_ripples_agree():
    """The law is measured on the last circles, and on the circle that `finer` returns for each."""
    ripples = [("cosine", d, 1 + d * study.ripple(2)) for d in (1e-2, 1e-3)]
    circles = [str(barriers.critical_scale(profile, 1e-3).omega) for *_, profile in ripples]
    laws = study.laws(xr.Dataset(coords=labels(ripples, "") | {"circle": ("forcing", circles)}))
    assert np.isnan(laws.measured[1:]).all()
    law = laws.sel(period=2)
    assert law.predicted_error < 1e-3 * law.predicted
    assert abs(law.measured - law.predicted) < law.measured_error + law.predicted_error < 0.03


def test_other_forcings_lose_barriers_before_constant_kicks_of_equal_rms():
    """Under (1.1, 0.9) the last barrier breaks at an rms of 0.66.

    Under constant kicks a start survives even at 0.971, just below κ_G.
    """
    ripple = np.array([1.1, 0.9]) / np.hypot(1.1, 0.9) * 2**0.5
    assert 0.66173460 < scale_without_barrier(ripple, KAPPA_G) <= 1.001 * KAPPA_G
    assert scale_without_barrier(np.ones(1), 0.97) == np.inf
    assert scale_without_barrier(np.array([1.4, 0.2]), KAPPA_G) < 0.9 * KAPPA_G
    end = random_climb(np.array([1.2, 0.7]), KAPPA_G, 200, 0)
    assert np.mean(end**2) == pytest.approx(1)
    assert abs(end) == pytest.approx([1, 1], abs=0.1)
    assert scale_without_barrier(end, KAPPA_G) < np.inf


def results(measured, upper):
    """Return the arguments of `findings` and of the figure.

    measured : exponents of the loss of the golden circle. upper : bounds for random forcings,
    followed by the bound for the end of a hill climb.
    """
    ripples = [("cosine", d, 1 + d * study.ripple(2)) for d in (1e-3, 1e-2)]
    cube = xr.Dataset(coords=labels(ripples, "")).assign(loss=("forcing", [0.02, 0.09]))
    law = {"measured": measured, "predicted": [0.64, 0.5]}
    laws = xr.Dataset({k: ("period", v) for k, v in law.items()}, {"period": [2, 3]})
    laws = laws.assign(measured_error=0.01 + 0 * laws.measured, predicted_error=0.001, orbits=9)
    families = (len(upper) - 1) * ["random"] + ["climb"]
    tried = xr.Dataset(coords=labels([(family, 0, [1]) for family in families], ""))
    tried["upper"] = "forcing", study.golden() * np.array(upper)
    tried = tried.assign_attrs(golden=study.golden())
    return cube.assign(loss_error=0.1 * cube.loss), laws, tried


def said_of(measured, upper):
    return study.findings(*results(measured, upper))


def test_verdicts_on_the_findings_about_ripples_follow_from_the_numbers():
    output = said_of([0.64, 0.5], [0.7, 1.001])
    assert output.count("Supported: ") == 2
    assert "forcings of 1 climbs where no orbit escapes" in output
    assert "orbits escape, at rms strengths of 0.50 κ_G" in said_of([0.64, 0.5], [1.001, 0.5])
    assert "Not supported" in said_of([0.64, 0.5], [np.inf, 0.5])
    assert "Not supported" in said_of([0.64, 0.5], [0.7, np.inf])
    assert "Supported with a caveat" in said_of([0.64, np.nan], [0.7, 0.5])
    assert "Not supported" in said_of([0.64, 0.6], [0.7, 0.5])
    assert "Not decided" in said_of([np.nan, np.nan], [0.7, 0.5])


def test_only_forcings_with_a_barrier_are_drawn_beyond_constant_kicks():
    """Forcings without a barrier are drawn at strengths up to κ_G, the limit for constant kicks."""
    for beyond in (0, 1):
        upper = [0.7, 1.001, 1.001, *beyond * [np.inf], 1.001]
        _, strengths = draw_tolerance(*results([0.64, 0.5], upper)).axes
        ends = {bar: bar.get_x() + bar.get_width() for bar in strengths.patches}
        drawn = {bar: bar.get_height() for bar, end in ends.items() if end < 1 + 1e-9}
        assert sum(drawn.values()) == 3
        assert sum(height for bar, height in drawn.items() if ends[bar] > 0.99) == 2
        assert sum(bar.get_height() for bar, end in ends.items() if end > 1 + 1e-9) == beyond
        (climbs,) = (line for line in strengths.lines if "climb" in line.get_label())
        assert climbs.get_xdata() <= 1


def test_missing_values_and_equal_values_are_described_in_words():
    output = said_of([0.64, 0.5], [0.7, 1.001])
    assert "P = none" not in output
    assert span(np.array([11.2, 10.8])) == "11"
    assert span(np.array([0.1, 0.3, np.nan])) == "0.1 to 0.3"
    assert span(np.array([np.nan])) == "unknown"
