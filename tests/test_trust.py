"""The Trust page counts broken promises, and each row of its table names an existing method."""

from importlib import import_module
from pathlib import Path
from pkgutil import resolve_name

import pytest
import xarray as xr

from nasm import barriers

NAN = float("nan")


@pytest.fixture
def page(monkeypatch):
    """Return a function that imports a module of the site."""
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / ".docs")
    return import_module


def test_a_ratio_above_one_breaks_a_promise_and_nan_counts_as_no_answer(page):
    ratio = xr.DataArray([0.5, 1.5, NAN, 2.0])
    seen = page("studies").by_ratio(barriers.critical_scale, "value", "rays", ratio)
    assert (seen.asked, seen.answered, seen.broken, seen.worst) == (4, 3, 2, 2.0)
    nothing = page("studies").by_ratio(barriers.critical_scale, "value", "rays", ratio[2:3])
    assert (nothing.answered, nothing.broken, page("measure_trust").short(nothing.worst)) == (
        0,
        0,
        "",
    )


def test_a_lower_bound_that_is_not_below_the_breakup_breaks_a_promise(page):
    lower, most = xr.DataArray([0.5, 1.0, NAN, 0.2]), xr.DataArray([0.6, 1.0, 0.3, NAN])
    seen = page("studies").below(barriers.critical_scale, "lower", "rays", lower, most)
    assert (seen.asked, seen.answered, seen.broken) == (4, 2, 1)


def test_verdicts_are_counted_by_section(page, tmp_path):
    lines = [
        "place,verdict",
        '"Sec. II, Eq. (7)",holds',
        '"Sec. II",holds',
        "Sec. III.A,not decided",
    ]
    (tmp_path / "claims.csv").write_text("\n".join(lines), encoding="utf-8")
    seen = page("studies").claims(tmp_path)
    assert [(section, sum(counts.values())) for section, counts in seen] == [
        ("Sec. II", 2),
        ("Sec. III.A", 1),
    ]


def test_each_measured_row_names_a_nasm_method_and_has_consistent_counts(page):
    trust = page("measure_trust")
    rows = trust.read(trust.MEASURED)
    assert {row["command"] for row in rows} <= {trust.COMMAND, *trust.STUDIES}
    for row in rows:
        method = resolve_name(row["method"])
        assert trust.name_of(method) == row["method"]
        assert 0 <= int(row["broken"]) <= int(row["answered"]) <= int(row["asked"]) > 0
        if row["worst ratio"]:
            assert (float(row["worst ratio"]) > 1) == (int(row["broken"]) > 0)


def test_a_row_measured_with_other_code_is_outdated(page):
    trust = page("measure_trust")
    row = {"method": "nasm.critical_scale", "code": trust.code_of(barriers.critical_scale)}
    assert not trust.has_changed(row)
    assert trust.has_changed(row | {"code": "0" * 12})


def test_each_method_is_judged_by_its_own_runs(page, monkeypatch):
    names = ["direct", "direct-100", "converse KAM, upper bound", "converse KAM, value"]
    names += ["blow-up of circles", "residue, Aitken", "last barrier, value"]
    ratios = xr.DataArray([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 1.7], dims="method")
    study = xr.Dataset(coords={"method": names, "ray": ["a", "b"]}).assign(
        error=ratios.expand_dims(ray=2, level=3),
        estimated_error=xr.ones_like(ratios),
        judge_error=("ray", [0.0, 0.0]),
        effort=xr.ones_like(ratios).expand_dims(level=3),
    )
    monkeypatch.setattr(page("studies"), "opened", lambda folder, name: study)
    seen = {each.method.__module__: each for each in page("studies").work_precision(Path())}
    assert {name: (each.asked, each.worst) for name, each in seen.items()} == {
        "nasm.escape": (12, 0.2),
        "nasm.converse_kam.symmetry_line": (12, 0.4),
        "nasm.circles.continuation": (6, 0.5),
        "nasm.periodic": (6, 0.6),
        "nasm.barriers": (6, 1.7),
    }


def test_only_changes_to_code_mark_rows_as_outdated(page):
    code = page("measure_trust").code_alone
    function = 'def f(x):\n    """Add."""\n    return "#" + x\n'
    same = f'"""Two."""\n\nX = 1  # one\n"""About X."""\n\n\n{function}'
    assert code(same) == code('X = 1\ndef f(x):\n    return "#" + x')
    assert code(same) != code(same.replace("1", "2"))
    assert code(same) != code(same.replace('"#"', '"##"'))
