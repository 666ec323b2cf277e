"""Kick patterns used in laboratories: properties of pairs, and the judgement of findings."""

import numpy as np
import pytest
import xarray as xr

from nasm import barriers, periodic
from pipeline.cubes.forcings import labels
from workflows.patterns import study


def findings_for(*scale):
    """Return the findings for pairs of kicks 1/2, 1/3 and 1/4 of a period apart with these K_c."""
    apart = 2, 3, 4
    pairs = [(study.PAIRS, 1 / q, study.pair(1, q)) for q in apart]
    cube = xr.Dataset({"critical_scale": ("forcing", np.divide(scale, apart))}, labels(pairs, ""))
    cube = cube.assign(lower=0.999 * cube.critical_scale, upper=1.001 * cube.critical_scale)
    return study.findings(cube)


def test_findings_on_patterns_follow_from_the_numbers():
    assert "Supported: " in findings_for(1.9, 0.9, 1.95)
    assert "Not supported: " in findings_for(1.9, 2.0, 1.95)
    assert "Not decided" in findings_for(1.9, np.nan, 1.95)


@pytest.mark.parametrize("q", [2, 3, 4, 5])
def test_pairs_drive_resonances_with_the_strength_that_the_command_states(q):
    """The first-order strength is 2K|cos πk/q|: orbits of period one have |R| = K|cos πk/q|/2."""
    K = 0.01
    results = [periodic.residue(K / q * np.array(study.pair(1, q)), k, 1) for k in range(q)]
    assert results == pytest.approx(K / 2 * abs(np.cos(np.pi * np.arange(q) / q)), abs=K**2)


def test_residues_confirm_the_threshold_of_pairs_a_third_of_a_period_apart():
    result = barriers.critical_scale((1, 1, 0), 1e-2)
    assert 3 * result.value == pytest.approx(0.90382345, abs=1e-7)
    assert periodic.critical_scale(result.omega, (1, 1, 0), 2000).value == pytest.approx(
        result.value
    )
