"""Ripples and random forcings against constant kicks: responses, laws, and rules that say no."""

import numpy as np
import pytest
import xarray as xr
from commands import succeed
from oracles import KAPPA_G

from nasm import barriers, periodic
from pipeline.cubes import robustness
from pipeline.cubes.forcings import labels
from workflows.tolerance import response, study


def test_residues_of_golden_orbits_respond_to_a_ripple_as_the_inverse_ring_says():
    """Against residues of two kicks that differ a little, and of one kick that is changed."""
    by_number = {q: both for _, q, both in response.responses()}
    for q in (3, 5, 8, 13):
        p = {3: 2, 5: 3, 8: 5, 13: 8}[q]
        up, down = (periodic.residue((KAPPA_G + h,), p, q) for h in (1e-5, -1e-5))
        assert by_number[q][1].sum() == pytest.approx((up - down) / 2e-5, rel=1e-5)
    ring = 2 + np.random.default_rng(0).uniform(-0.5, 0.5, 9)
    whole = np.diag(ring) - np.roll(np.eye(9), 1, axis=0) - np.roll(np.eye(9), -1, axis=0)
    diagonal, solve = response._inverse(ring)
    np.testing.assert_allclose(diagonal, np.diag(np.linalg.inv(whole)), rtol=1e-9)
    right = np.arange(9.0)
    np.testing.assert_allclose(whole @ solve(right), right, atol=1e-10)


def test_a_ripple_of_three_kicks_moves_residues_as_its_fourier_part_says():
    """Of the minimax orbits 2/3 of (1, 1, 1), one for each phase, the last to be eliminated is the
    one that the ripple moves down; periodic.residue finds the minimax over all."""
    _, _, (_, minimax) = next(each for each in response.responses() if each[1] == 3)
    f, h = study.shape(study.COSINE, 3), 1e-6
    phases = [f @ np.roll(minimax, shift) * KAPPA_G for shift in range(3)]
    moved = (periodic.residue(KAPPA_G * (1 + h * f), 2, 1) - periodic.residue((KAPPA_G,), 2, 3)) / h
    assert min(abs(moved - each) for each in phases) < 1e-3 * max(np.abs(phases))


def test_the_law_of_alternating_ripples_is_settled_and_their_loss_follows_it():
    exponent, error = response.predicted_exponent(np.array([1.0, -1.0]))
    assert exponent == pytest.approx(0.6408, abs=2e-4)
    assert error < 1e-3
    losses = []
    for d in (1e-2, 1e-3):
        profile = np.array([1 + d, 1 - d])
        found = barriers.critical_scale(profile, 1e-3)
        losses.append(1 - found.value * np.sqrt(np.mean(profile**2)) / KAPPA_G)
    assert np.log10(losses[0] / losses[1]) == pytest.approx(exponent, abs=0.03)


def test_forcings_next_to_constant_ones_hold_less_and_climbs_lead_to_these():
    low, high = robustness.bracket(np.array([1.0, -1.0]), KAPPA_G * 1.05)
    assert low < KAPPA_G * 1.01 < high * 1.03
    low, high = robustness.bracket(np.array([1.1, 0.9]) / np.hypot(1.1, 0.9) * 2**0.5, KAPPA_G)
    assert 0.99 * low < 0.66173460 < high  # the breakup; starts survive 100 periods a bit longer
    assert robustness.survival(np.ones(1), 0.97) == 10_000
    assert robustness.survival(np.array([1.1, 0.9]), KAPPA_G) == 0
    profile, scale = robustness.climb(np.array([1.2, 0.7]), KAPPA_G, np.random.default_rng(0))
    assert np.mean(profile**2) == pytest.approx(1)
    assert 0.95 * KAPPA_G < scale < 1.01 * KAPPA_G
    assert abs(profile) == pytest.approx([1, 1], abs=0.01)


def said_of(exponent, upper):
    """What is found of ripples whose loss is d^exponent, and of forcings with these bounds."""
    ripples = [(study.COSINE, d, 1 + d * study.shape(study.COSINE, 2)) for d in (1e-4, 1e-3, 1e-2)]
    cube = xr.Dataset(coords=labels(ripples, ""))
    cube["loss"] = cube.parameter**exponent
    cube["loss_error"] = 1e-3 * cube.loss
    tried = xr.Dataset({"upper": ("forcing", study.golden() * np.array(upper))})
    tried["parameter"] = "forcing", [1e-3, 0.5, 2.0]
    ends = xr.Dataset(coords=labels([("near", 0, [1.0, -1.0]), ("near", 1, [1.0, 0.3])], ""))
    ends["summit"] = ends.profile
    ends["reached"] = "forcing", [0.98, 0.5]
    ends["survived"] = "forcing", [100.0, 100.0]
    return study.found(cube, study.laws(cube), tried, study.at_summits(ends))


def test_findings_on_ripples_are_judged_by_the_numbers():
    predicted, _ = response.predicted_exponent(np.array([1.0, -1.0]))
    said = said_of(predicted, [0.99, 0.5, 0.2])
    assert said.count(" holds: ") == 2
    assert "1 climbs end at constant kicks" in said
    assert "not decided" in said  # longer periods were not tried
    assert "does not hold" in said_of(predicted, [np.inf, 0.5, 0.2])
    assert "holds with a caveat" in said_of(0.62, [0.99, 0.5, 0.2])
    assert "does not hold" in said_of(0.9, [0.99, 0.5, 0.2])


@pytest.mark.slow
def test_tolerances_are_kept_as_labelled_cubes(tmp_path, workers):
    out = tmp_path / "out"
    said = succeed("tolerance", out, "--quick", "--forcings", "14", "--climbs", "2", *workers)
    assert "1% cost 8.9%" in said.replace("\n", " ")
    cube = xr.open_zarr(out / "tolerance.zarr").load()
    assert cube.family.values.tolist() == ["cosine"] * 6
    tried = xr.open_zarr(out / "tolerance_random.zarr").load()
    assert (tried.upper < study.golden() * 1.0001).all()
    assert (tried.survived < tried.upper).all()
    assert (out / "tolerance.png").exists()
