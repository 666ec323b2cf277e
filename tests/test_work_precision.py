"""Speed against accuracy: errors decrease as expected, and error estimates are reliable."""

import numpy as np
import pytest
import xarray as xr
from cases import thirds
from oracles import KAPPA_G

from workflows.work_precision import __main__ as command
from workflows.work_precision import measure
from workflows.work_precision.methods import METHODS, PROFILES, judged

EFFORTS = {
    "cones": [100, 1000, 10_000],
    "circle": [64, 256, 1024],
    "continuation": [1e-1, 1e-2, 1e-3, 1e-4],
    "crossing": [30, 100, 300, 1000],
    "residue": [30, 100, 300, 1000],
    "barriers": [1e-2, 3e-3, 1e-3],
}
ORDERS = {  # the exponent in error ~ effort^exponent, and its tolerance
    "converse KAM, upper bound": (-1, 0.1),
    "residue, last crossing": (-2, 0.25),
    "last certified circle": (-1, 0.25),
    "last barrier, bracket": (1, 0.05),
}


@pytest.mark.parametrize("rays", thirds([("0", "30"), ("0", "three-kicks")]))
def test_errors_decrease_with_effort_and_error_estimates_cover_them(rays, monkeypatch):
    """Test the methods in EFFORTS at these small efforts, on rays with and without a symmetry."""
    for name, efforts in EFFORTS.items():
        monkeypatch.setattr(METHODS[name], "efforts", efforts)
    monkeypatch.setattr(measure, "timed", lambda run, *arguments: (run(*arguments), 1.0))
    measured = measure.measure(rays, [*EFFORTS], quick=False, show=bool)
    place = measured.method.values.tolist().index
    off = abs(float(measured.value[0]) / (KAPPA_G / 2) - 1)  # error of the reference value
    assert off <= float(measured.judge_error[0]) < 1e-11
    for name, (order, margin) in ORDERS.items():
        assert measure.order(measured, place(name)) == pytest.approx(order, abs=margin)
    claimed = measured.estimated_error + 10 * measured.judge_error
    rated = claimed.notnull().any(("ray", "level"))
    assert rated.sum() == 7
    honest = (measured.error <= claimed) | measured.error.isnull()
    assert honest.isel(method=np.flatnonzero(rated)).all()
    there = measured.effort.notnull().broadcast_like(measured.error)
    assert (measured.cpu_seconds.notnull() == there).all()
    for raw, corrected in (
        ("converse KAM, upper bound", "converse KAM, value"),
        ("residue, last crossing", "residue, Aitken"),
    ):
        errors = [measured.error[:, place(name)].values for name in (raw, corrected)]
        assert np.nanmax(errors[1] / errors[0]) < 0.2


def test_an_accuracy_counts_only_if_all_larger_efforts_also_reach_it():
    dims = "ray", "method", "level"
    errors = [[[1e-1, 1e-3, 1e-4]], [[1e-3, 1e-2, 1e-4]]]  # 1e-3 is first reached by chance
    seconds = [[[1.0, 2.0, 3.0]], [[1.0, 2.0, 4.0]]]
    efforts = (("method", "level"), [[1.0, 2.0, 3.0]])
    data = {"error": (dims, errors), "cpu_seconds": (dims, seconds), "effort": efforts}
    data = xr.Dataset(data)
    assert measure.seconds_for(data, 2e-3) == 4.0
    assert measure.seconds_for(data, 1e-1) == 1.0
    assert np.isnan(measure.seconds_for(data, 1e-5))


def test_the_bias_of_direct_iteration_falls_like_n_to_the_minus_one_third():
    ray = judged("45")
    steps = [1000, 10_000, 100_000]
    results = [METHODS["direct-100"].run(ray, n) for n in steps]
    errors = [raw / ray.value - 1 for (raw, _), _ in results]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(-1 / 3, abs=0.07)
    assert np.isnan(results[0][1]).all()  # 1000 steps are too few to extrapolate a value
    for (_, (value, error)), raw in zip(results[1:], errors[1:], strict=True):
        assert abs(value / ray.value - 1) < raw
        assert abs(value - ray.value) < error


def test_a_single_orbit_looks_quasiperiodic_beyond_the_breakup():
    ray = judged("45")
    ((scale, error),) = METHODS["birkhoff"].run(ray, 10_000)
    assert 1e-3 < scale / ray.value - 1 < 0.02
    assert np.isnan(error)


def test_the_options_name_all_methods_and_rays():
    assert tuple(METHODS) == command.NAMES
    assert tuple(PROFILES) == command.RAYS
