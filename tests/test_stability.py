"""Where methods stop being right: quick runs of the studies keep their promises."""

from functools import cache

import numpy as np
import pytest
import xarray as xr
from commands import succeed

from nasm.critical import Status
from workflows.stability.studies import STUDIES

OK = 1


@cache
def study(name):
    return STUDIES[name](quick=True).load()


@pytest.mark.slow
def test_each_study_keeps_a_labelled_dataset(tmp_path, monkeypatch):
    out = tmp_path / "out"
    for name, found in {name: study(name) for name in STUDIES}.items():
        monkeypatch.setitem(STUDIES, name, lambda quick, found=found: found)
    succeed("stability", out, "--quick")
    kept = {name: xr.open_zarr(out / f"stability_{name}.zarr").load() for name in STUDIES}
    for dataset in kept.values():
        for variable in dataset.variables.values():
            assert variable.attrs["long_name"]
            assert variable.attrs["units"] in ("1", "degree")
    assert kept["cusp"].status.attrs["flag_meanings"].split()[OK] == Status.OK.name.lower()
    for name in ("boundary", "searches", "orbits", "tori"):
        assert (out / f"stability_{name}.pdf").exists()


@pytest.mark.slow
def test_no_method_crosses_the_breakup():
    boundary = study("boundary")
    beyond, inside = boundary.sel(excess=slice(0, None)), boundary.sel(excess=slice(None, -1e-9))
    assert (beyond.certified == 0).all()
    assert (inside.isel(excess=0).certified == 1).all()
    assert np.isinf(inside.elimination_time).all()
    assert np.isinf(inside.escape_time).all()
    assert np.isinf(inside.escape_time_single).all()
    assert np.isfinite(beyond.sel(excess=slice(9e-4, None)).elimination_time).all()
    # Weighted Birkhoff averages are no proof of a circle.
    assert (boundary.sel(excess=1e-3, method="nearest").digits > 5).all()


def test_beyond_the_twist_nothing_is_certified():
    twist = study("twist")
    beyond = twist.scale > 1.5
    assert (twist.circle.where(beyond, 0) != OK).all()
    assert np.isfinite(twist.elimination_time.where(beyond, 1)).all()
    assert (twist.twist.sel(angle=90, scale=2.25) < 0).all()
