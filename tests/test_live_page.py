"""The live page, run in Chromium, agrees with nasm on orbits, rotation numbers and verdicts."""

import json
from pathlib import Path
from statistics import median

import numpy as np
import pytest

import nasm
from nasm import maps, orbits, verdict
from nasm.proofs import barrier, transport

PAGE = Path(__file__).parents[1] / ".docs" / "live" / "live.html"


@pytest.fixture(scope="module")
def page(chromium):
    tab = chromium.new_page()
    errors = []
    tab.on("pageerror", lambda error: errors.append(str(error)))
    tab.goto(f"{PAGE.as_uri()}#0.2,0.3")
    tab.locator("body[data-state=drawn]").wait_for()
    yield tab
    tab.close()
    assert errors == []


def test_one_step_agrees_with_the_map(page):
    rng = np.random.default_rng(1)
    for kappa, (x, y) in zip(
        rng.uniform(-1, 1, (100, 2)), rng.uniform(0, 1, (100, 2)), strict=True
    ):
        seen = page.evaluate("([kappa, x, y]) => step(kappa, x, y)", [list(kappa), x, y])
        assert seen == pytest.approx(maps.step(kappa, x, y), abs=1e-15)


def test_regular_orbits_agree_with_nasm_over_a_hundred_steps(page):
    rng = np.random.default_rng(2)
    for x, y in rng.uniform(0, 1, (20, 2)):
        kappa = [0.1, 0.05]
        seen = page.evaluate("([kappa, x, y]) => orbit(kappa, x, y, 100)", [kappa, x, y])
        expected = orbits.orbit(kappa, x, y, 100)
        np.testing.assert_allclose(np.array(seen).T, expected, rtol=0, atol=1e-10)


def test_a_rotation_number_is_the_weighted_birkhoff_average(page):
    kappa, y = [0.1, 0.05], 0.3
    seen = page.evaluate("([kappa, y]) => rotationNumber(kappa, 0, y, 4000)", [kappa, y])
    omega, _ = orbits.rotation_number(kappa, 0.0, y, 4000)
    assert seen == pytest.approx(float(omega), abs=1e-9)


def test_short_escape_times_agree_with_nasm(page):
    kappa, starts = [9.0, 7.0], np.linspace(0.01, 0.99, 30)
    call = "([kappa, y]) => escapeTime(kappa, 0.2, y, 5)"
    seen = [page.evaluate(call, [kappa, y]) for y in starts]
    expected = nasm.escape_time(kappa, np.full(30, 0.2), starts, 5)
    assert 5 < np.isfinite(expected).sum() < 30
    np.testing.assert_array_equal(np.array(seen, float), expected)


@pytest.mark.parametrize("n", [
    20,
    pytest.param(200, marks=pytest.mark.slow),
    pytest.param(1000, marks=pytest.mark.release),
])  # fmt: skip
def test_the_page_never_contradicts_a_verdict_from_nasm(page, n):
    """The page may answer UNDECIDED close to the boundary, for up to a tenth of the forcings."""
    kappas = np.random.default_rng(n).uniform(-1.2, 1.2, (n, 2))
    seen = page.evaluate("(kappas) => kappas.map(verdict)", kappas.tolist())
    for kappa, answer in zip(kappas, seen, strict=True):
        if answer != "UNDECIDED":
            assert verdict(kappa).answer.name in (answer, "UNDECIDED"), kappa
    assert seen.count("UNDECIDED") <= n / 10
    assert {"BARRIER", "TRANSPORT"} <= set(seen)


@pytest.mark.parametrize("n", [6, pytest.param(60, marks=pytest.mark.slow)])
def test_forcings_that_the_page_calls_proved_can_be_proved(page, n):
    """The page uses regions from `workflows.proved_map`; the test checks individual forcings."""
    random = np.random.default_rng(n)
    kappas = random.uniform(-1.125, 1.125, (20 * n, 2))
    seen = page.evaluate("(kappas) => kappas.map(proved)", kappas.tolist())
    chosen = {answer: kappas[np.array(seen) == answer][:n] for answer in ("BARRIER", "TRANSPORT")}
    assert min(map(len, chosen.values())) == n
    for kappa in chosen["TRANSPORT"]:
        assert transport.prove(kappa).proved, kappa
    for kappa in chosen["BARRIER"]:
        omega = nasm.critical_scale(kappa, 1e-2).omega
        assert barrier.prove(omega, kappa).proved, kappa


def test_proved_regions_are_on_the_correct_sides_of_the_boundary(page):
    program = """() => {
      const size = Math.hypot, turn = (x, y) => (Math.atan2(y, x) * 180) / Math.PI;
      const on = (x, y) => neighbours(turn(x, y)).map((ray) => BOUNDARY.value[ray]);
      const far = PROVED.triangles.flatMap(([a, b, c, d]) => [[a, b], [c, d]]);
      const cells = PROVED.runs.map(([row, from]) => [(from + 1) / PROVED.n, (row + 1) / PROVED.n]);
      return [far.map(([x, y]) => Math.max(...on(x, y)) / size(x, y)),
              cells.map(([x, y]) => size(x, y) / Math.min(...on(x, y)))];
    }"""
    for ratios, most in zip(page.evaluate(program), (1.25, 1.1), strict=True):
        assert len(ratios) >= 12
        assert 1 < min(ratios) <= median(ratios) < most  # regions are nearly as large as possible


def test_a_click_selects_a_forcing_and_records_it_in_the_address(page):
    box = page.locator("#plane").bounding_box()
    page.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + 0.25 * box["height"])
    chosen = [float(page.locator(f"#kappa{i}").input_value()) for i in (1, 2)]
    assert chosen == pytest.approx([0.6, 0.6], abs=0.01)
    assert json.loads(f"[{page.evaluate('location.hash.slice(1)')}]") == chosen
    assert page.locator("#verdict").inner_text().startswith("A barrier exists")
    assert "proved" in page.locator("#verdict").inner_text()


def test_the_page_is_small_and_loads_nothing_from_elsewhere(page):
    entries = page.evaluate("performance.getEntriesByType('resource').map((each) => each.name)")
    assert all(name.startswith("file:") for name in entries)
    assert sum(path.stat().st_size for path in PAGE.parent.iterdir()) < 50_000
