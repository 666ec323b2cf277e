"""Unsound one-token changes to the proofs: those that the tests caught before are still caught."""

import subprocess
import sys

import changes_of_proofs
import pytest
from changes_of_proofs import draw, source, table

NOTICED = [row["number"] for row in table() if "noticed" in row]


def test_a_seed_always_draws_the_same_changes_and_each_affects_one_line():
    drawn = draw(53, 30)
    assert drawn == draw(53, 30) != draw(54, 30)
    assert len({change[:3] for change in drawn}) == 30
    for change in drawn:
        text = source(change.module)
        pairs = zip(text.splitlines(), change.applied(text).splitlines(), strict=True)
        assert sum(right != wrong for right, wrong in pairs) == 1


@pytest.mark.parametrize("numbers", [range(100), range(400, 500)])  # seeds 53 and 71
def test_at_least_thirty_six_of_forty_unsound_changes_are_noticed(numbers):
    rows = [row for row in table() if row["number"] in numbers]
    assert len([row for row in rows if "noticed" in row]) >= 36
    assert len([row for row in rows if "harmless" not in row]) == 40


def test_each_change_drawn_later_is_noticed_or_harmless():
    later = [row for row in table() if row["number"] >= 200]
    assert all("noticed" in row for row in later if row["number"] < 400)
    assert all(("noticed" in row) != ("harmless" in row) for row in later)


def test_each_line_of_the_table_on_sums_of_two_floats_is_in_the_sources():
    rows = [row for row in table() if row["module"] == "residuals"]
    assert len(rows) >= 10
    for row in rows:
        assert changes_of_proofs.of_row(row).right == row["right"]


@pytest.mark.slow
def test_unsound_changes_are_still_noticed():
    """Check every twelfth noticed change of the table; `changes_of_proofs.py` checks them all."""
    numbers = NOTICED[::12]
    command = [sys.executable, changes_of_proofs.__file__, "table", *map(str, numbers)]
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert output.count("::test_") == len(numbers), output
