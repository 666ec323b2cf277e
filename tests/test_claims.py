"""The rules must be able to reject claims, and the page must contain all claims and verdicts."""

import ast
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from commands import table

from nasm.numbers import NAMES, parse
from pipeline.cubes.cube import untiled
from workflows.claims import envelope, rules
from workflows.claims.page import write
from workflows.claims.rules import Erratum
from workflows.claims.study import judgement, recorded
from workflows.shared.cli import main_of
from workflows.shared.judgement import Verdict, agrees, grade
from workflows.shared.page import formula
from workflows.shared.places import place_of
from workflows.shared.run import Run

TESTS = Path(__file__).parent


@pytest.mark.parametrize(
    ("value", "verdict"),
    [
        (rules.identity(1e-15, 1e-14), Verdict.HOLDS),
        (rules.identity(1e-13, 1e-14), Verdict.FAILS),
        (rules.identity(np.nan, 1e-14), Verdict.UNDECIDED),
        (agrees(0.97163540605, 1e-11, *rules.printed("0.971635406")), Verdict.HOLDS),
        (agrees(0.97163540705, 1e-11, *rules.printed("0.971635406")), Verdict.FAILS),
        (agrees(np.nan, 1e-11, 0.971635406), Verdict.UNDECIDED),
        (agrees(0.97, np.nan, 0.971635406), Verdict.UNDECIDED),
        (agrees(0.97, 1.0, 0.97, np.nan), Verdict.UNDECIDED),
        (grade("", True), Verdict.HOLDS),
        (grade("", False, True), Verdict.CAVEAT),
        (grade("", False, False), Verdict.FAILS),
        (grade("", True, True, known=False), Verdict.UNDECIDED),
    ],
)
def test_the_rules_give_the_expected_verdicts(value, verdict):
    assert value[1] is verdict
    assert (rules.printed("0.97"), rules.printed("3")) == ((0.97, pytest.approx(0.005)), (3.0, 0.5))


def test_an_erratum_is_shown_only_if_both_numbers_confirm_it():
    numbers = (0.1, 1e-14), (0.1, 1e-9), (1e-14, 1e-14), (np.nan, 0.0)  # printed, corrected
    errata = [Erratum("", "", "", *two, 1e-12, "", "") for two in numbers]
    assert [erratum.shown for erratum in errata] == [True, False, False, False]


def test_wrong_equations_are_rejected(monkeypatch):
    from workflows.claims import map as paper_map

    monkeypatch.setattr(paper_map, "kick", lambda kappa, x, y: (x - y, y))
    wrong = [verdict for _, verdict in paper_map.map_claims().values()]
    assert wrong.count(Verdict.FAILS) >= 4
    monkeypatch.setattr(paper_map, "closed_form", lambda kappa, x, y: np.array([x, x]))
    assert paper_map.symmetry_claims()["sym_3"][1] is Verdict.FAILS


def three_rays(ours, circle, six):
    """Return data on three rays: the paper's six circles, which break at `six`·CB_gt, and CB_gt."""
    angles = np.array([0.0, 20.0, 45.0])
    names = [str(parse(name)) for name in NAMES]
    small = np.full((6, 3), 1e-10)
    barrier = {"critical_scale": ours, "error": small[0], "circle": circle}
    barrier |= {"lower": 0.999 * ours, "upper": 1.001 * ours}
    barrier = xr.Dataset({k: ("angle", v) for k, v in barrier.items()}, {"angle": angles})
    circles = {"critical_scale": np.outer(np.full(6, six), ours), "error": small}
    circles = {name: (("circle", "angle"), values) for name, values in circles.items()}
    circles = xr.Dataset(circles, {"circle": names, "angle": angles})
    return circles, barrier


def test_claims_on_the_envelope_and_the_hull_are_judged_by_numbers():
    from workflows.claims.results import hull_claims

    horned = three_rays(np.array([0.5, 0.6, 1.4]), ["[0;(1)]"] * 3, 0.99)
    expected = [Verdict.FAILS, Verdict.HOLDS, Verdict.CAVEAT]
    assert [verdict for _, verdict in hull_claims(*horned).values()] == expected
    octagon = three_rays(np.array([1.0, 1.0, 1.0]), ["[0;(1)]"] * 3, 1.0)
    assert {verdict for _, verdict in hull_claims(*octagon).values()} == {Verdict.HOLDS}
    poor = three_rays(np.array([1.0, np.nan, 1.0]), ["[0;(1)]", "", "[0;(1)]"], 0.9)
    judged = hull_claims(*poor)
    assert judged["envelope"][1] is judged["six"][1] is Verdict.FAILS
    parted = three_rays(np.array([0.5, 0.6, 1.4]), ["[0;(1)]", *["[0;1,3,(1)]"] * 2], 0.99)
    rows = envelope.ranges(*parted)
    expected = [(0.0, 0.0, "[0;(1)]"), (20.0, 45.0, "[0;1,3,(1)]")]
    assert [(row["from"], row["to"], row["circle"]) for row in rows] == expected
    assert rows[0]["bracket"] == pytest.approx(0.002)
    assert [rows[1][name] for name in NAMES] == [pytest.approx(0.01)] * len(NAMES)
    assert envelope.cells(rows[1])[:3] == ("20 – 45", "[0;1,3,(1)]", "2e-03")
    assert "1.000%" in envelope.summary(*parted, rows)[0]


def test_text_is_escaped_and_subscripts_are_set():
    text = formula("<script> & T_κ1κ2 < R_{-½} (sim_M)")
    assert text == "&lt;script&gt; &amp; T<sub>κ1κ2</sub> &lt; R<sub>-½</sub> (sim_M)"


@pytest.fixture(scope="module")
def exact():
    """Return the claims that need no sweep, and the errata."""
    from workflows.claims.boundary import _reductions
    from workflows.claims.circles import circle_claims
    from workflows.claims.errata import errata
    from workflows.claims.map import map_claims, symmetry_claims
    from workflows.claims.periodic import periodic_claims

    result = map_claims() | symmetry_claims() | periodic_claims() | circle_claims()
    return rules.claims_of(rules.as_texts(result | _reductions())), errata()


def test_no_equation_fails_and_all_errata_are_shown(exact):
    judged, errata = exact
    assert {claim.verdict for claim in judged} == {Verdict.HOLDS, Verdict.CAVEAT}
    assert all(claim.note for claim in judged if claim.verdict is Verdict.CAVEAT)
    assert all(erratum.shown for erratum in errata)


def test_claims_and_errata_are_read_back_from_the_cube_unchanged(exact, tmp_path):
    judged, errata = exact
    texts = rules.printed_texts("claims")
    names = {(text["place"], text["statement"]): name for name, text in texts.items()}
    words = {names[each.place, each.statement]: (each.value, each.verdict) for each in judged}
    with Run(tmp_path, place_of(tmp_path), {}, False).driving() as run:
        cube = run.kept(untiled("claims"), lambda: recorded(words, errata))
    assert judgement(cube) == (judged, errata)


def test_the_page_and_the_tables_contain_every_claim(exact, tmp_path):
    judged, errata = exact
    circles, barrier = three_rays(np.array([0.5, 0.6, 1.4]), ["[0;(1)]"] * 3, 0.99)
    ranges, run = envelope.ranges(circles, barrier), Run(tmp_path, None, {}, False)
    write(run, judged, errata, ranges, ["a summary"], "a command")
    page = (tmp_path / "claims.html").read_text(encoding="utf-8")
    for c in judged:
        assert_holds(page, c.place, c.statement, c.value, c.command)
    for e in errata:
        assert_holds(page, e.place, e.printed, e.corrected, e.command)
    for row in ranges:
        assert_holds(page, "a summary", "Made by <code>a command</code>.", *envelope.cells(row))
    assert [row["value"] for row in table(tmp_path / "claims.csv")] == [c.value for c in judged]
    assert len(table(tmp_path / "claims_errata.csv")) == len(errata)
    assert len(table(tmp_path / "claims_envelope.csv")) == len(ranges)


def test_the_page_begins_with_failed_claims_and_shows_each_command_once(exact, tmp_path):
    judged, errata = exact
    last = replace(judged[-1], verdict=Verdict.FAILS, value="the one that fails")
    circles, barrier = three_rays(np.array([0.5, 0.6, 1.4]), ["[0;(1)]"] * 3, 0.99)
    ranges, run = envelope.ranges(circles, barrier), Run(tmp_path, None, {}, False)
    write(run, [*judged[:-1], last], errata, ranges, [], "a command")
    page = (tmp_path / "claims.html").read_text(encoding="utf-8")
    claims, rest = page.split("<h2>Errata</h2>")
    shown = re.findall('<tr class="([a-z-]+)">', claims)
    assert len(shown) == len(judged)
    assert shown == sorted(shown, key=["does-not-hold", "holds-with-a-caveat", "holds"].index)
    assert claims.index("the one that fails") < claims.index(formula(judged[0].value))
    assert table(tmp_path / "claims.csv")[-1]["value"] == "the one that fails"
    for part, of in ((claims, judged), (rest, errata)):
        for command in {each.command for each in of}:
            assert part.count(f"<code>{command}</code>") == 1


def assert_holds(page, *texts):
    for text in texts:
        assert f">{formula(text)}<" in page or text in page


@pytest.mark.parametrize("kind", ["claims", "errata"])
def test_the_commands_quoted_by_claims_exist_with_their_options_and_tests(kind):
    for texts in rules.printed_texts(kind).values():
        assert_exists(texts["command"])


def assert_exists(command):
    python, dash, module, *rest = command.split()
    assert (python, dash) == ("python", "-m")
    options = [word for word in rest if word.startswith("--")]
    if module == "pytest":
        path, _, test = rest[0].partition("::")
        tree = ast.parse((TESTS.parent / path).read_text(encoding="utf-8"))
        defined = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        assert not test or test in defined, command
    else:
        known = main_of(module.removeprefix("workflows.")).params
        assert set(options) <= {name for option in known for name in option.opts}, command
