"""Frequency maps compared with exact rotations, a symmetry, and time series of their orbits."""

import numpy as np
from commands import invoke, succeed
from numpy.testing import assert_allclose

from nasm import orbits
from pipeline import jobs, store


def computed(*arguments):
    """Return the coordinates and arrays of a frequency map, computed as one tile."""
    job = jobs.frequency_map(*arguments)
    coords = {name: job.cube.template[name].values for name in "xy"}
    return coords, job.compute(coords, job.cube.settings)


def test_without_kicks_omega_is_p_times_y():
    coords, arrays = computed([0.0] * 3, "0:1:4", "-0.5:0.5:7", 500)
    assert_allclose(arrays["omega"], np.tile(3 * coords["y"][:, None], 4), rtol=0, atol=1e-13)


def test_the_map_has_the_symmetry_of_the_forcing():
    # (x, y) → (-x, -y) takes orbits to orbits, and ω to -ω.
    _, arrays = computed((0.3, 0.2), "-0.5:0.5:12", "-0.5:0.5:12", 2000)
    omega = arrays["omega"]
    both = np.isfinite(omega) & np.isfinite(omega[::-1, ::-1])
    assert both.mean() > 0.5
    few = np.minimum(arrays["digits"], arrays["digits"][::-1, ::-1])[both]
    assert (np.abs(omega + omega[::-1, ::-1])[both] < 2 * 10.0**-few).mean() > 0.98


def test_omega_in_a_cell_agrees_with_the_time_series_of_its_orbit():
    kappa = (0.4, 0.1, 0.2)
    coords, arrays = computed(kappa, "0:1:6", "0:0.5:6", 2000)
    x, _ = orbits.orbit(kappa, *np.meshgrid(coords["x"], coords["y"]), 2000)
    omega, digits = orbits.rotation_number_of(x)
    regular = arrays["digits"] > 8
    assert regular.sum() > 9
    errors = 10.0**-digits + 10.0 ** -arrays["digits"]
    assert (np.abs(omega - arrays["omega"]) < errors)[regular].all()


def test_the_command_computes_the_same_map_as_the_function(tmp_path, workers):
    options = ["--position", "0:1:8", "--momentum", "0:1:8", "--n-max", "100", *workers]
    succeed("frequency_map", tmp_path, "0.3", "-0.2", *options)
    cube = store.read(store.place_of(tmp_path), "frequency_map")
    _, arrays = computed((0.3, -0.2), "0:1:8", "0:1:8", 100)
    np.testing.assert_array_equal(cube.omega, arrays["omega"])
    for wrong, reason in ((), "KAPPA is missing"), (("1e7",), "strengths are from -1e+06 to 1e+06"):
        result = invoke("frequency_map", tmp_path / "wrong", *wrong, *options)
        assert result.exit_code == 2
        assert reason in " ".join(result.output.split())
    assert not (tmp_path / "wrong").exists()
