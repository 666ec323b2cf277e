"""Test the table of judged forcings and the script that judges them.

The search for the last barrier must also agree with the table.
"""

from collections import Counter
from dataclasses import replace
from math import inf, isnan, nan

import judge_forcings
import numpy as np
import oracles
import pytest
import score_search
import short_orbits
from cases import thirds
from judged import image, table

from nasm import barriers, numbers, symmetries
from nasm.results import CriticalScale, Status

ROWS = table()
JUDGED = {n: row for n, row in ROWS.items() if row.image_of is None}


def test_every_row_is_complete_and_in_order():
    assert list(ROWS) == sorted(ROWS)
    assert max(Counter((row.profile, row.start) for row in ROWS.values()).values()) == 1
    for row in ROWS.values():
        assert 0 < row.error < row.value
        assert not row.lower >= row.value
        assert row.value - row.error < row.upper
        assert row.start is None or len(row.start) == len(row.profile)
        assert row.method in ("residues", "bracket", "proof", "literature") or row not in JUDGED
        assert not row.omega or not numbers.parse(row.omega).is_rational
        if row.method == "bracket":
            assert row.value == pytest.approx((row.lower + row.upper) / 2, rel=1e-15)


def test_images_agree_with_the_rows_from_which_they_are_derived():
    images = [row for row in ROWS.values() if row.number not in JUDGED]
    assert len(images) > 20
    assert [row.number for row in images if judge_forcings.doubts(row)] == []


@pytest.mark.parametrize(
    "operations", ["shift 1", "reverse", "negate", "alternate", "shift 3; negate; alternate"]
)
def test_an_image_of_a_forcing_is_equivalent_to_it(operations):
    row = replace(next(iter(ROWS.values())), profile=(0.3, 0.1, -0.2, 0.7), start=None)
    profile, *_ = image(row, operations)
    equivalent = [form[0] for _, form in symmetries.equivalent_forcings(np.array([row.profile]))]
    assert any(np.array_equal(form, profile) for form in equivalent)


def test_shortening_undoes_repetition_and_pauses_rescale_y():
    row = replace(next(iter(ROWS.values())), profile=(0.3, 0.1), start=None)
    repeated, _, factor, _ = image(row, "repeat 3")
    (short,), _ = symmetries.shorten([repeated], numbers.parse("gamma"))
    assert (tuple(short), factor) == ((0.3, 0.1), 1)
    # Kicks n sites apart act on (x, n·y) like kicks n times as strong at every site.
    paused, _, factor, _ = image(row, "pause 3")
    assert (paused, factor) == ((0.3, 0, 0, 0.1, 0, 0), 1 / 3)
    x, y = 0.2, 0.15
    x_paused, y_paused = x, y / 3
    for strength in (0.3, 0.1):
        x, y = oracles.kick(strength, x, y)
        x_paused, y_paused = oracles.kick(strength / 3, x_paused, y_paused)
        x_paused = x_paused + 2 * y_paused
    assert (x_paused, y_paused) == pytest.approx((x, y / 3), abs=1e-15)


@pytest.mark.parametrize(("kappa", "p", "q"), [((0.97,), 8, 13), ((0.68, 0.15), 5, 8)])
def test_the_judge_and_shooting_on_symmetry_lines_agree_on_residues(kappa, p, q):
    """Residues on symmetry lines are computed by shooting, to 25 digits."""
    omega = numbers.parse("gamma")
    zero, kappa = np.zeros(len(kappa)), np.array(kappa)
    _, u = judge_forcings.circle_below(omega, zero, kappa, 1.0, 1e-2)
    orbits = judge_forcings.MinimaxOrbits(omega, zero, kappa, u)
    (i,) = (i for i, f in enumerate(orbits.fractions) if f.as_integer_ratio() == (p, q))
    expected = max(short_orbits.on_symmetry_lines(kappa, p, q))
    assert orbits.residue(i, 1.0) == pytest.approx(expected, abs=1e-9)


def test_the_judge_reproduces_the_breakup_of_the_golden_circle():
    profile = np.ones(1)
    value, error, _ = judge_forcings.breakup(numbers.parse("gamma"), 0 * profile, profile, 0.9716)
    assert abs(value - oracles.KAPPA_G) < error < 1e-7


TRUE = next(row for row in ROWS.values() if len(row.profile) == 2 and row.method == "residues")


def test_a_true_row_is_not_doubted():
    assert judge_forcings.doubts(TRUE) == []


@pytest.mark.parametrize(
    ("name", "factor", "words"),
    [
        ("lower", 1.001, "no circle"),
        ("upper", 0.999, "a start survives"),
        ("value", 1 + 1e-6, "by residues"),
    ],
)
def test_a_false_row_is_reported_with_the_reason(name, factor, words):
    false = replace(TRUE, **{name: factor * TRUE.value})
    assert words in " ".join(judge_forcings.doubts(false))


def test_a_row_contradicts_a_search_that_deviates_by_more_than_the_errors():
    row = replace(
        ROWS[min(ROWS)], value=1.0, error=1e-6, lower=0.999, upper=1.001, method="bracket"
    )
    true = CriticalScale(1.0, 1e-6, 0.9, 1.1, None, Status.OK)

    def false(**changes):
        return score_search.contradictions(row, replace(true, **changes))

    assert false() == false(lower=1.001, upper=1.001) == false(value=1 + 1.9e-6) == ()
    assert false(value=nan, error=nan, lower=nan) == ()
    assert false(value=1 - 2.1e-6) == ("value",)
    assert false(lower=1.0011) == ("lower",)
    assert false(upper=0.9989) == ("upper",)
    by_residues = replace(row, method="residues")
    assert score_search.contradictions(by_residues, replace(true, upper=1 - 2e-6)) == ("upper",)


def test_the_report_counts_answers_and_lists_wrong_or_missing_ones():
    def search(profile, tol, start=None):
        if len(profile) == 1:
            raise ZeroDivisionError
        status = Status.OK if len(profile) == 2 else Status.UNDECIDED
        value = 1.0 if len(profile) == 2 else nan
        return CriticalScale(value, 0.1, 0.5, 1.5, None, status)

    row = replace(ROWS[min(ROWS)], kind="some", value=1.5, error=0.1, lower=1.4, upper=1.6)
    rows = [replace(row, number=n, profile=n * (1.0,), start=None) for n in (1, 2, 3)]
    scores = [score_search.score(search, row, 1e-3) for row in rows]
    assert [score.answered for score in scores] == [False, True, False]
    assert scores[0].width == inf
    _, some, total, _, *result = score_search.report(scores)
    assert some.split()[1:8] == ["3", "1", "1", "0", "0", "6.7e-01", "6.7e-01"]
    assert total.split()[1:8] == some.split()[1:8]
    assert [line.partition(": ")[0] for line in result if "row" in line] == [
        "row 1",
        "row 2",
        "row 3",
    ]
    assert result[1].startswith("row 2: value: ")


CHEAP = [row for row in ROWS.values() if row.kind in ("one kick", "two kicks")]


@pytest.mark.parametrize("row", thirds({row.number: row for row in CHEAP}))
def test_the_search_contradicts_no_row_with_one_or_two_kicks(row):
    result = score_search.score(barriers.critical_scale, row, 1e-3)
    assert result.false == ()
    assert result.answered
    assert not isnan(result.found.lower)


def test_the_requested_number_of_images_of_each_judged_row_is_scored():
    assert score_search.with_images(list(ROWS.values()), 0) == list(JUDGED.values())
    some = score_search.with_images(list(ROWS.values()), 1)
    assert len(JUDGED) < len(some) <= 2 * len(JUDGED)
    assert score_search.with_images(list(ROWS.values()), len(ROWS)) == list(ROWS.values())


@pytest.mark.parametrize("images", [
    pytest.param("1", marks=pytest.mark.slow),
    pytest.param(str(len(ROWS)), marks=pytest.mark.release),
])  # fmt: skip
def test_the_search_contradicts_no_row(images, capsys):
    code = score_search.main(["--images", images, "--minutes", "30"])
    print(capsys.readouterr().out)
    assert code == 0


@pytest.mark.slow
@pytest.mark.parametrize("row", list(JUDGED.values())[::10], ids=lambda row: str(row.number))
def test_the_judge_confirms_every_tenth_row(row):
    assert judge_forcings.doubts(row) == []
