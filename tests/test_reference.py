"""Reference values: plain Python reproduces them, and contradictions between methods are found."""

import ast
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracles import KAPPA_G, second_variation

import nasm
from nasm import periodic
from nasm.circles import invariant_circle
from workflows.reference import circle_through, spreading, study
from workflows.reference import second_variation as variation
from workflows.reference.symmetric import gap_flux, symmetric_orbit
from workflows.reference.writing import write
from workflows.shared.run import Run

PUBLISHED = Path(__file__).parents[1] / ".docs" / "reference" / "values.json"
VALUES = json.loads(PUBLISHED.read_text(encoding="utf-8"))["values"]
CHECKED = [value for value in VALUES if value["check"]]
QUICKLY = "residue", "rotation_number", "escape_time"


def lines_agree(value):
    """Return True if the lines, run by Python without third-party packages, reproduce the value."""
    lines = "\n".join(value["check"]["lines"])
    names = [
        name for node in ast.walk(ast.parse(lines)) if isinstance(node, ast.ImportFrom)
        for name in [node.module]
    ]  # fmt: skip
    assert {*names} <= {"math", "random"}
    process = subprocess.run(
        [sys.executable, "-I", "-S", "-c", lines], capture_output=True, text=True, check=True
    )
    allowed = value["check"]["accuracy"] * abs(value["value"]) + value["error"]
    return abs(float(process.stdout) - value["value"]) <= allowed


FEW = [value for value in CHECKED if value["kind"] in QUICKLY][::4]


@pytest.mark.parametrize("value", FEW, ids=lambda value: value["name"])
def test_plain_python_reproduces_a_value(value):
    assert lines_agree(value)
    assert not lines_agree(value | {"value": 1.2 * value["value"] + 1e-3})


@pytest.mark.slow
@pytest.mark.parametrize(
    "value", [value for value in CHECKED if value not in FEW], ids=lambda value: value["name"]
)
def test_plain_python_reproduces_the_other_values(value):
    assert lines_agree(value)


def test_published_values_have_the_names_and_methods_of_the_program():
    cases = study.cases(quick=False)
    assert [value["name"] for value in VALUES] == [case.name for case in cases]
    assert {value["verdict"] for value in VALUES} == {"confirmed"}
    for value, case in zip(VALUES, cases, strict=True):
        assert value["definition"] == study.KINDS[case.kind]["definition"]
        assert value["method"] == case.written("method")
        assert abs(value["value"] - value["second_value"]) == value["difference"]


@pytest.mark.slow
def test_a_preview_agrees_with_the_published_values():
    published = {value["name"]: value for value in VALUES}
    for value in study.entries(study.measured(quick=True), quick=True):
        expected = published[value["name"]]
        assert abs(value["value"] - expected["value"]) <= value["error"] + expected["error"]


@pytest.mark.parametrize("kind", ["residue", "rotation_number"])
def test_the_command_stored_with_a_value_reproduces_the_value(kind, capsys):
    for value in [value for value in VALUES if value["kind"] == kind][::5]:
        _, _, line = value["command"].partition(' -c "')
        exec(line.removesuffix('"'), {"nasm": nasm, "print": lambda out: print(np.ravel(out)[0])})
        found = float(capsys.readouterr().out)
        assert abs(found - value["value"]) <= value["error"]


def test_the_critical_strength_agrees_with_the_literature():
    (value,) = [value for value in VALUES if value["kind"] == "critical_strength"]
    assert abs(value["value"] - KAPPA_G) <= value["error"] < 1e-10


def test_a_value_is_contradicted_if_methods_differ_beyond_their_errors(tmp_path, monkeypatch):
    right = next(case for case in study.cases(quick=True) if case.kind == "residue")
    value, error = right.measure_again()
    answers = {
        "confirmed": (value, error),
        "contradicted": (value + 1e-3, 0.9e-3),
        "not decided": (np.nan, error),
    }
    cases = [
        replace(right, conditions=right.conditions | {"note": name}, measure_again=lambda a=a: a)
        for name, a in answers.items()
    ]
    monkeypatch.setattr(study, "cases", lambda quick: cases)
    cube = study.measured(quick=True)
    found = study.entries(cube, quick=True)
    assert [entry["verdict"] for entry in found] == list(answers)
    run = Run(tmp_path, None, {}, False)
    write(run, found, {"computed_by": "", "studied_by": ""})
    assert [line.partition(":")[0] for line in run.findings[1:]] == ["Contradicted"]
    read = json.loads((tmp_path / "reference.json").read_text(encoding="utf-8"))["values"]
    assert [entry["second_value"] for entry in read] == [value, value + 1e-3, None]
    page = (tmp_path / "reference.html").read_text(encoding="utf-8")
    assert page.count('class="does-not-hold"') == page.count('class="not-decided"') == 1


def test_shooting_requires_a_forcing_with_a_centre_of_symmetry():
    with pytest.raises(ValueError, match="the same forwards and backwards"):
        symmetric_orbit((0.5, 0.3, 0.2), 1, 2, 0.5)


def test_the_second_residue_detects_a_change_of_1e_9_in_the_strength():
    exact = periodic.residue((0.9,), 3, 8)
    orbit, other = (symmetric_orbit((kappa,), 3, 8, 0.5) for kappa in (0.9, 0.9 + 1e-9))
    assert abs(orbit.residue - exact) <= orbit.error < 1e-12 < abs(other.residue - exact)


def test_the_flux_through_the_gap_of_a_fixed_point_agrees_with_the_formula():
    area, error = gap_flux((0.8,), 0, 1)
    assert abs(area - 0.8 / (2 * np.pi**2)) <= error < 1e-14


def test_rotation_numbers_match_the_circle_and_are_nan_in_chaos():
    circle = invariant_circle("[0;1,1,(2)]", (0.5,), settings=circle_through.FINE)
    y = circle_through.momentum_on(circle, 0.3)
    omega, error = circle_through.rotation_number((0.5,), 0.3, y)
    assert abs(omega - float(circle.omega)) <= error < 1e-8
    assert np.isnan(circle_through.rotation_number((2.0,), 0.3, 0.62)).all()


def test_a_start_survives_while_its_second_variation_is_positive():
    kappa = 0.97 + 0.01 * np.arange(-30, 31)
    y = np.linspace(0.3, 0.7, 41)
    times = variation.lifetimes(kappa, 30, 0.5, y)
    for start, time in zip(y, times, strict=True):
        assert second_variation(kappa, 30, 0.5, start, int(time)) <= 0
        assert time == 1 or second_variation(kappa, 30, 0.5, start, int(time) - 1) > 0


def test_without_correlations_diffusion_is_quasilinear():
    # Between such strong kicks, x advances so far that successive kicks are uncorrelated.
    value, error = spreading.green_kubo((1000.3,), 512, 512, 16)
    assert value == pytest.approx((1000.3 / (4 * np.pi)) ** 2, rel=0.05)
    assert 0 < error < 0.05 * value


def test_escape_by_transport_between_cells_agrees_with_escape_of_orbits():
    mean, factor = spreading.escapes((8.0,), (-2.0, 2.3), 0.3, 30)
    times = nasm.escape_time((8.0,), *nasm.escape.ensemble(20_000), 10_000)
    assert mean == pytest.approx(times.mean(), rel=0.05)
    assert factor == pytest.approx(1 - 1 / (times[times > 20] - 20).mean(), rel=0.05)
