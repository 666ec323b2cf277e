"""Compare diffusion rates with theory, between equivalent forcings, and between sets of orbits."""

import numpy as np
import pytest
import xarray as xr
from scipy.special import jv

from nasm.barriers import critical_scale
from nasm.diffusion import diffusion
from nasm.results import Status
from nasm.symmetries import ray
from workflows.diffusion import study


def rechester_and_white(one, two):
    """Return D for a forcing of two kicks, with correlations up to a lag of four kicks.

    See Rechester and White, Phys. Rev. Lett. 44 (1980) 1586.
    """
    (a1, a2, a3), (b1, b2, b3) = ([jv(order, kappa) for order in (1, 2, 3)] for kappa in (one, two))
    alone = one**2 * (1 - 2 * b2 + 2 * b2**2) + two**2 * (1 - 2 * a2 + 2 * a2**2)
    return (alone + 4 * one * two * (a3 * b3 - a1 * b1)) / (4 * np.pi) ** 2


@pytest.mark.parametrize("kappa", [(9.0, 9.0), (30.0, 17.0), (-41.0, 8.5), (55.0, 71.0)])
def test_diffusion_under_strong_kicks_agrees_with_rechester_and_white(kappa):
    result = diffusion(kappa, 2048)
    assert result.status is Status.OK
    theory = rechester_and_white(*kappa)
    assert abs(result.value - theory) < 4 * result.error + 0.08 * theory


def test_diffusion_rates_of_equivalent_forcings_agree():
    for one, other, factor in (
        ((1.8, 1.8), (1.8,), 2),
        ((0.9, 0.0), (1.8,), 0.25),
        ((1.3, 0.6), (-0.6, -1.3), 1),
    ):
        one, other = diffusion(one), diffusion(other)
        assert one.status is other.status is Status.OK
        error = np.hypot(one.error, factor * other.error)
        assert abs(one.value - factor * other.value) < 4 * error < 0.5 * one.value


def test_the_error_matches_the_scatter_of_results_from_different_orbits():
    results = [diffusion((1.6, 1.1 + 1e-7 * i), 256) for i in range(60)]
    scatter = np.std([each.value for each in results], ddof=1)
    assert scatter == pytest.approx(np.mean([each.error for each in results]), rel=0.3)


def test_no_rate_is_returned_if_a_barrier_or_accelerator_mode_exists():
    inside = [critical_scale(ray(angle), 1e-2).lower * ray(angle) for angle in (0.0, 30.0, 45.0)]
    results = [diffusion(kappa, 64, 2**17) for kappa in inside]
    assert {each.status for each in results} == {Status.NOT_CONVERGED}
    modes = list(map(diffusion, [(6.4, 6.4), (6.4, 0.0), (6.5,)]))
    assert {each.status for each in modes} == {Status.ANOMALOUS}
    assert np.isnan([each.value for each in results + modes]).all()


@pytest.mark.parametrize(
    ("ratio", "exponent", "expected"),
    [
        (1, 3.01, ". Supported: "),
        (0.2, 3.3, ". Supported with a caveat: "),
        (1.5, 4, ". Not supported: "),
        (np.nan, 3, ". Not decided: "),
    ],
)
def test_findings_can_reject_a_claim_or_leave_it_undecided(ratio, exponent, expected):
    excess = xr.DataArray(np.geomspace(0.05, 3.2, 16), dims="excess")
    flux = 0.01 * excess**exponent * xr.DataArray(np.ones(3), {"angle": [0.0, 20, 45]}, "angle")
    fields = {"diffusion": ratio * flux, "error": 0.05 * ratio * flux, "ratio": ratio + 0 * flux}
    law = xr.Dataset(fields, {"excess": excess.values}).assign(prefactor=0.01 + 0 * flux[0])
    assert [expected in line for line in study.findings(law).splitlines()] == [True] * 2
