"""Kicks as laboratories give them: what is measured of pairs, and rules that can say no."""

import numpy as np
import pytest
import xarray as xr
from commands import succeed
from oracles import KAPPA_G

from nasm import periodic
from nasm.numbers import parse
from pipeline.cubes.forcings import labels, profiles_of, with_circles
from workflows.patterns import study


def said_of(scale, strength=0.0):
    """What is found of pairs 1/2, 1/3, 1/4, 1/16, 1/24 and 1/64 with these K_c, and constant kicks;
    resonances are off by `strength`."""
    apart = 2, 3, 4, 16, 24, 64
    pairs = [(study.PAIRS, 1 / q, study.pair(1, q)) for q in apart]
    cube = xr.Dataset(coords=labels([(study.CONSTANT, 1, [1.0]), *pairs], ""))
    cube["critical_scale"] = "forcing", np.array([1.0, *np.divide(scale, apart)])
    cube = cube.assign(lower=0.999 * cube.critical_scale, upper=1.001 * cube.critical_scale)
    driven = study.resonances([2, 3])
    driven["strength"] = driven.first_order + strength
    return study.found(study.in_lab_units(cube), driven)


def test_findings_on_patterns_are_judged_by_the_numbers():
    good = [1.9, 0.9, 1.95, 3.5, 4.5, 7.9]
    assert said_of(good).count(" holds: ") == 4
    for place, wrong in {1: 2.0, 4: 4.95, 0: 3.0}.items():  # 1/3 not first, no limit, beyond κ_G
        said = said_of([*good[:place], wrong, *good[place + 1 :]])
        assert (said.count(" holds: "), said.count("does not hold")) == (3, 1), said
    assert said_of(good, 0.02).count("does not hold") == 1
    assert "not decided" in said_of([1.9, 0.9, np.nan, *good[3:]])


def test_resonances_of_two_kicks_are_those_of_the_papers_formula():
    """|R| = (κ1 + κ2)/2 - κ1κ2/4 of the orbit at rest, and κ1κ2/4 of that of half turns."""
    kappa = 0.01 / 2
    driven = study.resonances([2], strength=0.01).strength.values[0]
    assert driven == pytest.approx([4 / 0.01 * (kappa - kappa**2 / 4), 4 / 0.01 * kappa**2 / 4])


@pytest.mark.slow
def test_patterns_are_kept_with_thresholds_that_residues_confirm(tmp_path, workers):
    out = tmp_path / "out"
    said = succeed("patterns", out, "--quick", "--tol", "0.1", *workers)
    cube = with_circles(xr.open_zarr(out / "patterns.zarr"))
    assert "holds" in said
    assert float(cube.critical_scale[0]) == pytest.approx(KAPPA_G, abs=1e-9)
    for i, profile in enumerate(profiles_of(cube)):
        here = cube.isel(forcing=i)
        if profile.size == 3:
            expected = periodic.critical_scale(parse(here.circle.item()), profile, 2000)
            assert abs(expected.value - here.critical_scale) < expected.error + here.error
            assert here.lower < expected.value < here.upper
    third = cube.sel(forcing="1, 1, 0")
    assert float(third.critical_scale) * 3 == pytest.approx(0.90382345, abs=1e-7)
    assert (out / "patterns.png").exists()
