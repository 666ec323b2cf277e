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
def test_near_the_cusp_errors_are_honest_or_there_is_no_answer():
    cusp = study("cusp")
    answered = cusp.status == OK
    assert np.isnan(cusp.off.where(~answered)).all()
    assert ((cusp.off <= cusp.error + cusp.judge_error) | cusp.off.isnull()).all()
    assert answered.sel(approach=2).all()  # converse KAM always has an answer
    assert answered.sel(delta=slice(None, 0.05)).all()


@pytest.mark.slow
def test_no_method_crosses_the_breakup():
    boundary = study("boundary")
    beyond, inside = boundary.sel(excess=slice(0, None)), boundary.sel(excess=slice(None, -1e-9))
    assert (beyond.certified == 0).all()
    assert (inside.isel(excess=0).certified == 1).all()
    assert np.isinf(inside.elimination_time).all()
    assert np.isinf(inside.escape_time).all()
    assert np.isfinite(beyond.sel(excess=slice(9e-4, None)).elimination_time).all()
    # Weighted Birkhoff averages are no proof of a circle.
    assert (boundary.sel(excess=1e-3, method="nearest").digits > 5).all()


@pytest.mark.slow
def test_disguised_fractions_get_no_wrong_answer():
    fractions = study("fractions")
    value, error = fractions.value, fractions.error
    norms, residues = value.sel(approach=1), value.sel(approach=2)
    off = abs(norms - residues) <= error.sel(approach=1) + error.sel(approach=2)
    assert (off | norms.isnull() | residues.isnull()).all()
    assert int((norms.notnull() & residues.notnull()).sum()) >= 3
    # Behind a quotient of a million, no residue of a period within reach knows the circle.
    assert (fractions.status.sel(quotient=10**6, approach=0) != OK).all()
    assert not (fractions.lower > fractions.attrs["golden"]).any()


def test_beyond_the_twist_nothing_is_certified():
    twist = study("twist")
    beyond = twist.scale > 1.5
    assert (twist.circle.where(beyond, 0) != OK).all()
    assert np.isfinite(twist.elimination_time.where(beyond, 1)).all()
    assert (twist.twist.sel(angle=90, scale=2.25) < 0).all()


@pytest.mark.slow
def test_amplitudes_are_far_below_one():
    amplitude = study("amplitude")
    assert amplitude["last"].notnull().all()
    assert (amplitude["last"] < 0.25).all()
    assert amplitude.attrs["justified_exit"] < 1.25


@pytest.mark.slow
def test_what_a_search_or_a_certificate_must_reject_is_there_and_rejected():
    missed, fakes, disorder = study("beam").missed, study("fakes"), study("disorder")
    assert float(missed.sel(kept=1)) > 0.3
    assert float(missed.sel(kept=32)) == 0
    assert (fakes.fakes > 0).all()
    assert (fakes.past.sel(n=16) > 0.2).all()
    assert not (fakes.passed + fakes.polished).any()
    assert float(disorder.refused.sel(scale=1.2, method="nearest").max()) > 0.1
    assert not disorder.accepted.any()


@pytest.mark.slow
def test_next_to_a_resonance_or_past_the_end_no_torus_is_claimed():
    tori = study("tori")
    nearest = tori.sel(delta=1e-10, method="nearest")
    assert (nearest.status != OK).all()
    assert nearest.lower.isnull().all()
    assert int((tori.status == OK).sum()) >= 2
    assert not (tori.lower >= tori.upper).any()
    assert not (tori.value + tori.error < tori.lower).any()
    assert (tori.past != OK).all()
