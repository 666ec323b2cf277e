"""Diffusion against theory, exact reductions, and itself with other orbits."""

import numpy as np
import pytest
import xarray as xr
from commands import succeed, table
from numpy.testing import assert_allclose
from scipy.special import jv

from nasm import escape, orbits
from nasm.barriers import critical_scale
from nasm.critical import Status
from nasm.diffusion import _iterate, diffusion, strong_kicks
from nasm.symmetries import ray
from pipeline.cubes import diffusion as cubes
from pipeline.sweep.grid import Axis
from workflows.diffusion import study


def agree(one, other, factor=1.0, errors=4):
    assert one.status is other.status is Status.OK
    error = np.hypot(one.error, factor * other.error)
    assert abs(one.value - factor * other.value) < errors * error < 0.5 * one.value


def test_the_kernel_iterates_the_map():
    kappa, x, y = (0.7, -0.4), np.linspace(0, 1, 64), np.linspace(0.3, 1.9, 64)
    shifted, momenta = x - 0.25, y.copy()
    _iterate(escape.kick_series(np.array(kappa)), shifted, momenta, 20)
    xs, ys = orbits.orbit(kappa, x, y, 20)
    assert_allclose(momenta, ys[-1], atol=1e-9)
    assert_allclose((shifted + 0.25 - xs[-1] + 0.5) % 1, 0.5, atol=1e-9)


@pytest.mark.parametrize("strength", [5.2, 9.7, 40.0])
def test_with_equal_kicks_theory_is_that_of_rechester_and_white(strength):
    j1, j2, j3 = (jv(n, strength) for n in (1, 2, 3))
    of_p = strength**2 / 2 * (0.5 - j2 - j1**2 + j2**2 + j3**2)  # D of p = 2πy, one kick
    assert strong_kicks(strength, strength) == pytest.approx(2 * of_p / (2 * np.pi) ** 2)


@pytest.mark.parametrize("kappa", [(9.0, 9.0), (30.0, 17.0), (-41.0, 8.5), (55.0, 71.0)])
def test_strong_kicks_diffuse_as_theory_says(kappa):
    found = diffusion(kappa, 2048)
    assert found.status is Status.OK
    theory = strong_kicks(*kappa)
    assert abs(found.value - theory) < 4 * found.error + 0.08 * theory


def test_three_strong_kicks_diffuse_without_correlations():
    kappa = np.array([150.0, 121.0, 170.0])
    found = diffusion(kappa, 2048)
    quasilinear = (kappa**2).sum() / (4 * np.pi) ** 2
    assert abs(found.value - quasilinear) < 4 * found.error + 0.05 * quasilinear


def test_the_standard_map_is_on_both_the_axes_and_the_diagonal():
    once = diffusion((1.8,))
    agree(diffusion((1.8, 1.8)), once, 2)
    agree(diffusion((0.9, 0.0)), once, 0.25)


@pytest.mark.parametrize("strength", [1.5, 2.0])
def test_chaotic_orbits_of_the_standard_map_diffuse_as_published(strength):
    """<Δp²>/t = (K - K_c)³/3, a fit; Chirikov & Shepelyansky, Scholarpedia 3 (2008) 3550."""
    found = diffusion((strength,))
    x, y = np.meshgrid((np.arange(64) + 0.5) / 64, (np.arange(64) + 0.5) / 64)
    chaotic = np.isfinite(escape.escape_time((strength,), x, y, 50_000, (-2.0, 3.0))).mean()
    of_chaos = 8 * np.pi**2 * found.value / chaotic
    assert of_chaos == pytest.approx((strength - 0.9716) ** 3 / 3, rel=0.25)


def test_images_of_a_forcing_diffuse_alike():
    one = diffusion((1.3, 0.6))
    for image in ((0.6, 1.3), (-1.3, -0.6), (1.3, -0.6)):
        agree(one, diffusion(image))


def test_the_error_is_the_scatter_of_other_orbits():
    found = [diffusion((1.6, 1.1 + 1e-7 * i), 256) for i in range(60)]
    scatter = np.std([each.value for each in found], ddof=1)
    assert scatter == pytest.approx(np.mean([each.error for each in found]), rel=0.3)


def test_where_a_barrier_is_there_is_no_answer():
    for angle in (0.0, 30.0, 45.0):
        inside = critical_scale(ray(angle), 1e-2).lower * ray(angle)
        found = diffusion(inside, 64, 2**17)
        assert (found.status, found.steps) == (Status.NOT_CONVERGED, 2**17)
        assert np.isnan(found.value)


@pytest.mark.parametrize("kappa", [(6.4, 6.4), (6.4, 0.0), (6.5,)])
def test_accelerator_modes_have_no_diffusion(kappa):
    found = diffusion(kappa)
    assert found.status is Status.ANOMALOUS
    assert np.isnan(found.value)
    assert found.exponent > 1.5


def test_a_plane_is_computed_beyond_the_boundary_and_is_0_within():
    job = cubes.over_plane(
        "plane", [(0.0, 0.48, 0.49), (45.0, 1.3, 1.37)], Axis(0, 2, 4), 64, 2**14
    )
    coords = {name: job.cube.template[name].values for name in ("kappa1", "kappa2")}
    found = job.compute(coords, job.cube.settings)
    assert (found["steps"] == 0).tolist() == [[True] + [False] * 3] + [[False] * 4] * 3
    assert (found["diffusion"][0, 0], found["error"][0, 0]) == (0, 0)
    expected = diffusion((1.75, 1.25), 64, 2**14)
    assert found["diffusion"][2, 3] == expected.value > 0
    assert job.predict(coords, job.cube.settings) > 0


def law_of(ratio, exponent):
    excess = study.excesses()
    coords = {"angle": [0.0, 20.0, 45.0], "excess": excess}
    flux = 0.01 * excess**exponent * np.ones((3, 1))
    names = {"one_cantorus": flux, "diffusion": ratio * flux, "error": 0.05 * ratio * flux}
    names |= {"ratio": ratio + 0 * flux, "status": np.ones_like(flux)}
    return xr.Dataset({name: (("angle", "excess"), v) for name, v in names.items()}, coords)


@pytest.mark.parametrize(
    ("ratio", "exponent", "off", "said"),
    [
        (1.0, 3.01, 1.0, ["holds:", "holds:", "holds:", "holds:"]),
        (0.2, 3.2, 1.3, ["holds:", "does not hold:", "caveat:", "caveat:"]),
        (1.5, 4.0, 9.0, ["holds:", "does not hold:", "does not hold:", "does not hold:"]),
    ],
)
def test_the_rules_can_say_no(ratio, exponent, off, said):
    kappa, rng = np.linspace(5, 9, 12), np.random.default_rng(1)
    noise = 1 + 0.01 * rng.standard_normal((12, 12))
    dims = ("kappa2", "kappa1")
    variables = {"diffusion": (dims, off * noise), "error": (dims, np.full((12, 12), 0.01 * off))}
    variables |= {"strong_kicks": (dims, np.ones((12, 12))), "status": (dims, np.ones((12, 12)))}
    plane = xr.Dataset(variables, {"kappa1": kappa, "kappa2": kappa})
    lines = study.findings(law_of(ratio, exponent), plane, plane).splitlines()
    assert [words in line for words, line in zip(said, lines, strict=True)] == [True] * 4


@pytest.mark.slow
def test_diffusion_is_kept_as_labelled_cubes(tmp_path, workers):
    out = tmp_path / "out"
    said = succeed("diffusion", out, "--quick", "--cells", "8", "--n-max", "8192", *workers)
    plane = xr.open_zarr(out / "diffusion.zarr").load()
    assert plane.diffusion.dims == ("kappa2", "kappa1")
    assert (float(plane.diffusion[0, 0]), float(plane.steps[0, 0])) == (0, 0)
    cell = plane.isel(kappa1=7, kappa2=2)
    expected = diffusion((float(cell.kappa1), float(cell.kappa2)), 256, 8192)
    assert float(cell.diffusion) == expected.value
    rays = xr.open_zarr(out / "diffusion_rays.zarr")
    assert rays.diffusion.dims == ("angle", "excess")
    assert len(table(out / "diffusion.csv")) == rays.diffusion.size
    assert "D(κ1, κ2) = D(κ2, κ1): " in said
    assert (out / "diffusion.png").exists()
