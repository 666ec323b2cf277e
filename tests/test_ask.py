"""Test the command `ask`: files and tables of forcings, JSON, and periods too long to search."""

import json

import numpy as np
import pytest
from commands import invoke, table

from nasm import escape
from nasm.barriers import Effort, critical_scale
from nasm.converse_kam import aperiodic
from nasm.results import Status
from nasm.verdicts import Answer, Evidence, verdict
from workflows.ask import records
from workflows.shared.cli import main_of
from workflows.shared.forcing_files import forcings_in

SHORT = np.array([0.3, 0.2, 0.25])


def lengthened(kicks):
    """Return the kicks repeated 23 times, with the last strength changed by a negligible amount."""
    kappa = np.tile(kicks, 23)
    kappa[-1] += 1e-9
    return kappa


@pytest.mark.parametrize(
    ("text", "forcings"),
    [
        ("0.3\n-0.2\n", [[0.3, -0.2]]),
        ("0.3, 0.2; 0.1", [[0.3, 0.2, 0.1]]),
        ("\ufeff0.3\r\n# a remark\r\n0.2 # another\r\n", [[0.3, 0.2]]),
        ("kappa1,kappa2\n0.3,0.2\n", [[0.3, 0.2]]),
        ("0.3 0.2\n0.5\n\n1,2,3\n", [[0.3, 0.2], [0.5], [1, 2, 3]]),
    ],
)
def test_a_file_contains_one_forcing_or_one_on_each_line(text, forcings):
    result, is_table = forcings_in(text.encode())
    assert [forcing.tolist() for forcing in result] == forcings
    assert is_table == (len(forcings) > 1)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("0.3 0.2\n0.5 x\n", "line 2: 'x' is not a number"),
        ("0.3 0.2\n1e7 0\n", "line 2: .*too large"),
        ("", "line 1"),
        ("0.3 nan\n1 2", "line 1"),
    ],
)
def test_the_error_for_an_invalid_file_names_the_line(text, reason):
    with pytest.raises(ValueError, match=reason):
        forcings_in(text.encode())


def test_json_contains_the_verdict(tmp_path):
    kicks = tmp_path / "kicks.txt"
    kicks.write_text("0.3\n0.2\n")
    expected = verdict((0.3, 0.2))
    for words in ("0.3", "0.2"), (str(kicks),):
        result = invoke("ask", tmp_path / "out", *words, "--json", "--quiet")
        answer = json.loads(result.stdout)
        assert (answer["answer"], answer["kappa"]) == (expected.answer.value, [0.3, 0.2])
        assert (answer["value"], answer["omega"]) == (
            expected.boundary.value,
            str(expected.boundary.omega),
        )
        assert answer["steps"] is None
    assert not (tmp_path / "out").exists()


def test_a_table_is_answered_line_by_line_and_an_interrupt_loses_no_answer(tmp_path, monkeypatch):
    (tmp_path / "many.csv").write_text("a,b\n0.3,0.2\n1.2,0.9\n0,0\n")
    result = invoke("ask", tmp_path / "out", str(tmp_path / "many.csv"))
    assert result.exit_code == 0, result.output
    rows = table(tmp_path / "out/ask.csv")
    assert [row["answer"] for row in rows] == ["barrier", "transport", "barrier"]
    assert [row["status"] for row in rows] == ["ok", "ok", "no_breakup"]

    def answered(strengths, prove, known=records.answered):
        if strengths[0] == 1.2:
            raise KeyboardInterrupt
        return known(strengths, prove)

    monkeypatch.setattr(records, "answered", answered)
    invoke("ask", tmp_path / "again", str(tmp_path / "many.csv"))
    rows = table(tmp_path / "again/ask.csv")
    assert [row["answer"] for row in rows] == ["barrier"]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("many.csv", "0.3"), "leave other KAPPA"),
        (("many.csv", "--once", "many.csv"), "leave --plane and --once out"),
        (("--once", "kicks.txt", "--json"), "--json needs a periodic forcing"),
        (("missing.csv",), "no such file"),
    ],
)
def test_a_file_with_conflicting_arguments_is_refused(words, reason, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "many.csv").write_text("0.3,0.2\n1.2,0.9\n")
    (tmp_path / "kicks.txt").write_text("0.3\n0.2\n")
    result = invoke("ask", tmp_path / "out", *words)
    assert (result.exit_code, reason in " ".join(result.output.split())) == (2, True), result.output


def test_upper_for_a_long_period_is_just_above_the_short_period_breakup():
    short, long = critical_scale(SHORT, 1e-3), critical_scale(lengthened(SHORT), 1e-3)
    assert long.status is Status.TOO_LONG
    assert np.isnan([long.value, long.error, long.lower]).all()
    assert long.omega is None
    assert short.value < long.upper < 1.12 * short.value


def test_for_a_long_period_transport_is_shown_but_barriers_are_not():
    barrier, beyond = verdict(lengthened(SHORT)), verdict(lengthened(2 * SHORT))
    assert (barrier.answer, barrier.evidence) == (Answer.UNDECIDED, Evidence.NONE)
    assert (beyond.answer, beyond.evidence) == (Answer.TRANSPORT, Evidence.CONVERSE_KAM)
    assert beyond.boundary.upper <= 1


def test_escapes_lower_the_upper_bound_where_circles_are_steep():
    profile = np.random.default_rng(1).uniform(0.1, 1, 128)
    result = critical_scale(profile, 1e-2, effort=Effort(iterated_kicks=1_280_000))
    without_graphs = aperiodic.critical_scale(aperiodic.around_strongest(profile), 1e-2).upper
    (x, y), n = escape.ensemble(64), 10_001
    assert result.method == escape.METHOD
    assert result.upper < 0.5 * without_graphs
    assert escape.first_escape(result.upper * profile, x, y, [64], n)[0] <= n


def test_a_failed_proof_for_a_long_period_states_what_the_theorem_requires(tmp_path):
    answer = verdict(lengthened(2 * SHORT), prove=True)
    assert (answer.answer, answer.evidence) == (Answer.TRANSPORT, Evidence.CONVERSE_KAM)
    assert (answer.proof.proved, "at most 64" in answer.proof.reason) == (False, True)
    np.savetxt(tmp_path / "long.txt", answer.kappa)
    asked = str(tmp_path / "long.txt"), "--prove", "--json", "--quiet"
    result = invoke("ask", tmp_path / "out", *asked)
    assert json.loads(result.stdout)["answer"] == "transport"


def test_a_number_is_not_mistaken_for_a_file_of_that_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "0.3").write_text("0.9")
    assert main_of("ask").make_context("ask", ["0.3", "-1e-2"]).params["kappa"] == (0.3, -0.01)


def test_an_escape_shows_transport_even_if_the_search_finds_survivors(monkeypatch):
    survivor = aperiodic.last_survivor(aperiodic.around_strongest(SHORT))
    assert survivor.kicks == np.inf
    monkeypatch.setattr(aperiodic, "last_survivor", lambda _: survivor)
    monkeypatch.setattr(aperiodic, "critical_scale", lambda *_: critical_scale(SHORT, 1e-2))
    result = verdict(lengthened(4 * SHORT))
    assert (result.answer, result.evidence) == (Answer.TRANSPORT, Evidence.ESCAPE)
    (x, y), n = escape.ensemble(64), 10_000
    assert escape.first_escape(np.tile(4 * SHORT, 23), x, y, [64], n)[0] < n


def test_a_waveform_of_4096_kicks_has_an_upper_bound():
    phase = 2 * np.pi * np.arange(4096) / 4096
    profile = 1 + 1e-6 * np.cos(phase)  # close to the standard map
    result = critical_scale(profile, 1e-2)
    assert 0.971635 < result.upper * profile.max() < 1.03 * 0.971635
