"""A verdict on one forcing agrees with the boundary, is never a guess, and is stated correctly."""

import re
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import islice

import numpy as np
import pytest
from cases import thirds
from commands import invoke

from nasm import barriers, circles, orbits, periodic
from nasm.action import ConvergentOrbits
from nasm.circles import hull
from nasm.converse_kam import symmetry_line
from nasm.maps import MAX_STRENGTH
from nasm.numbers import convergents, parse
from nasm.results import CriticalScale, Status, no_answer
from nasm.symmetries import ray
from nasm.verdicts import Answer, Evidence, VerdictSettings, verdict
from workflows.ask import period
from workflows.shared.verdict_sentences import bracket_of, sentences

_RANDOM = np.random.default_rng(5)
ANGLES = [-45.0, *_RANDOM.uniform(0, 360, 2)]


@pytest.fixture(scope="module", params=thirds(ANGLES))
def boundary(request):
    profile = ray(request.param)
    return profile, barriers.critical_scale(profile, 1e-4).value


@pytest.mark.parametrize("distance", [1e-2, 1e-3, 1e-4])
def test_verdicts_agree_with_the_boundary_on_both_sides(boundary, distance):
    profile, value = boundary
    inside = verdict(value * (1 - distance) * profile)
    assert (inside.answer, inside.evidence) == (Answer.BARRIER, Evidence.CIRCLE)
    assert inside.boundary.value == pytest.approx(1 / (1 - distance), abs=1e-8)
    outside = verdict(value * (1 + distance) * profile)
    assert (outside.answer, outside.evidence) == (Answer.TRANSPORT, Evidence.CONVERSE_KAM)
    assert outside.boundary.value == pytest.approx(1 / (1 + distance), abs=1e-8)
    assert outside.boundary.omega == inside.boundary.omega


def test_on_the_boundary_a_verdict_is_undecided_and_states_the_bracket():
    value = barriers.critical_scale((1.0, 1.0), 1e-3).value
    result = verdict((value, value))
    assert (result.answer, result.circle) == (Answer.UNDECIDED, None)
    assert result.boundary.lower < 1 < result.boundary.upper < result.boundary.lower + 3e-5


PAIRS = (0.3, 0.4), (0.6, 0.6), (0.6, -0.6), (-0.6, 0.6)


@pytest.mark.parametrize("kappa", [*PAIRS, (0.3,), (0.4, 0, -0.4, 0), (0, 0.4, 0, -0.4)])
def test_the_circle_has_the_rotation_number_of_the_verdict(kappa):
    result = verdict(kappa)
    x, y = result.circle
    omega = orbits.rotation_number(kappa, x[0], y[0], 10_000)[0] % len(kappa)
    assert min(omega, len(kappa) - omega) == pytest.approx(float(result.boundary.omega), abs=1e-7)


@pytest.mark.parametrize("case", thirds([(-1e-2, "BARRIER"), (1e-2, "TRANSPORT")]))
def test_a_forcing_without_symmetry_gets_a_verdict(case):
    distance, answer = case
    result = verdict(np.array([0.3, 0.2, 0.25]) * 1.79656 * (1 + distance))
    assert result.answer is Answer[answer]
    assert str(result.boundary.omega) == "[1;4,(1)]"
    assert (result.circle is not None) == (result.evidence is Evidence.CIRCLE)


@pytest.mark.parametrize("size", [1e-300, 1e-310, pytest.param(5e-324, marks=pytest.mark.slow)])
def test_under_the_weakest_kicks_a_circle_exists_and_no_value_is_infinite(size):
    result = verdict((size, 0.0))
    assert (result.answer, result.evidence) == (Answer.BARRIER, Evidence.CIRCLE)
    if size == 1e-300:
        exact = verdict((0.25, 0.0)).boundary.value * 0.25
        assert result.boundary.value * size == pytest.approx(exact, rel=1e-12)
    else:
        assert result.boundary == no_answer(result.boundary.omega, Status.NO_BREAKUP)


@pytest.mark.parametrize("kappa", [(2.0, 0.0), (0.1, -3.0), (MAX_STRENGTH, -MAX_STRENGTH)])
def test_no_circle_exists_if_a_kick_has_a_strength_of_two_or_more(kappa):
    result = verdict(kappa)
    assert (result.answer, result.steps) == (Answer.TRANSPORT, 0.5)


@pytest.mark.slow
def test_close_to_a_cusp_the_forcing_itself_still_determines_the_verdict():
    inside, outside = verdict((0.9, 0.9000001)), verdict((1.0, 1.0000001))
    assert np.isnan(inside.boundary.value)
    assert inside.boundary.status is outside.boundary.status is Status.NEAR_CUSP
    assert (inside.answer, outside.answer) == (Answer.BARRIER, Answer.TRANSPORT)


# By default, up to 20 CPU seconds would be spent on proofs of barriers further out on the ray.
SHORT_PROOFS = VerdictSettings(proof_seconds=1.0)
# The second search takes 0.3 s; with the default settings it takes 1 s.
WIDER_BRACKETS = VerdictSettings(tol=1e-3, min_distance=1e-4)


@pytest.mark.parametrize("kappa", [(0.3, 0.45), (0.526, 0.69)])
def test_without_a_certified_circle_the_verdict_is_undecided(monkeypatch, kappa):
    def failing(omega, kappa, *args):
        u = np.zeros((2, 64))
        return circles.InvariantCircle(omega, np.array(kappa), u, np.nan, Status.NOT_CERTIFIED)

    monkeypatch.setattr(circles, "invariant_circle", failing)
    monkeypatch.setattr(hull, "certified_circle", lambda *_: (np.nan, None))
    # This avoids long tests of other circles.
    monkeypatch.setattr(hull, "circle_near_orbit", lambda *_: None)
    result = verdict(kappa, settings=WIDER_BRACKETS)
    assert (result.answer, result.evidence) == (Answer.UNDECIDED, Evidence.NONE)


def test_a_circle_certified_further_out_is_a_barrier_under_an_assumption(monkeypatch):
    monkeypatch.setattr(hull, "certified_circle", lambda *given: (given[2], None))
    assert verdict((0.526, 0.69), settings=WIDER_BRACKETS).evidence is Evidence.CIRCLE_BEYOND


def test_if_starts_are_never_eliminated_the_verdict_is_undecided(monkeypatch):
    monkeypatch.setattr(symmetry_line, "longest_lived", lambda kappa, n_max: (0.2, np.inf))
    assert verdict((1.2, 0.9), settings=WIDER_BRACKETS).answer is Answer.UNDECIDED


def test_if_converse_kam_contradicts_a_circle_the_verdict_is_undecided(monkeypatch):
    monkeypatch.setattr("nasm.survivors.eliminates", lambda kappa, n_max: True)
    result = verdict((0.3, 0.4), settings=WIDER_BRACKETS)
    assert result.boundary.lower > 1
    assert result.answer is Answer.UNDECIDED


def test_without_residues_only_the_forcing_itself_determines_the_verdict(monkeypatch):
    lost = lambda omega, *_, **__: no_answer(omega, Status.DISORDERED)  # noqa: E731
    monkeypatch.setattr(periodic, "critical_scale", lost)
    assert verdict((0.3, 0.4)).answer is Answer.BARRIER
    assert verdict((1.2, 0.9)).answer is Answer.TRANSPORT


@pytest.mark.parametrize(
    ("kappa", "evidence"),
    [
        ((0.3, 0.45), Evidence.CIRCLE_PROVED),
        ((1e-301,), Evidence.CIRCLE_PROVED),
        ((-0.75, 0.6), Evidence.TRANSPORT_PROVED),
    ],
)
def test_a_proof_is_a_separate_kind_of_evidence(kappa, evidence):
    result, sampled = verdict(kappa, prove=True, settings=SHORT_PROOFS), verdict(kappa)
    assert result.evidence is evidence
    assert result.proof.proved
    assert result.answer is sampled.answer
    assert sampled.evidence in (Evidence.CIRCLE, Evidence.CONVERSE_KAM)
    text = " ".join(sentences(np.array(kappa), None, result))
    assert "proved for exactly this forcing" in text
    assert "proved" not in " ".join(sentences(np.array(kappa), None, sampled))


@pytest.mark.parametrize(
    ("kappa", "evidence"), [((0.3, 0.45), Evidence.CIRCLE), ((-0.75, 0.6), Evidence.CONVERSE_KAM)]
)
def test_a_failed_proof_leaves_the_evidence_unchanged_and_gives_its_reason(kappa, evidence):
    result = verdict(kappa, prove=True, settings=replace(WIDER_BRACKETS, proof_seconds=1e-9))
    assert result.evidence is evidence
    assert not result.proof.proved
    assert "A proof was attempted: not proved: " in " ".join(
        sentences(np.array(kappa), None, result)
    )


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        (
            ("-0.69", "0.525"),
            ["TRANSPORT", "ω = [0;4,(1)] = [0;4,1,1,1,…]", "excludes", "this close to"],
        ),
        (("0.526", "0.69"), ["BARRIER", "ω = [0;1,3,(1)]", "certified"]),
        (("1.5", "-1.5"), ["TRANSPORT", "Direct iteration: the orbit from"]),
        (("0", "0"), ["BARRIER", "without kicks"]),
        pytest.param(
            ("0.7", "0.7", "--prove"),
            ["BARRIER", "proved for exactly", "A barrier exists"],
            marks=pytest.mark.slow,
        ),
        (("1e-310", "0"), ["BARRIER", "is not known: no breakup found"]),
    ],
)
def test_the_answer_is_given_in_words_and_as_a_figure(monkeypatch, tmp_path, point, expected):
    briefly = partial(verdict, settings=SHORT_PROOFS)
    monkeypatch.setattr("workflows.ask.period.verdict", briefly)
    result = invoke("ask", tmp_path / "out", *point)
    assert result.exit_code == 0, result.output + repr(result.exception)
    for words in expected:
        assert words in result.output
    name = "ask_{}_{}".format(*map(float, point[:2]))
    assert (tmp_path / f"out/{name}.png").stat().st_size > 5000
    assert (tmp_path / f"out/{name}.txt").read_text(encoding="utf-8") in result.output


def test_strengths_and_a_point_in_a_plane_can_specify_the_same_forcing(tmp_path, monkeypatch):
    kappas, answer = [], verdict((0.3, 0.3, 0.3))
    seen = (
        "workflows.ask.period.verdict",
        lambda kappa, prove: kappas.append(tuple(kappa)) or answer,
    )
    monkeypatch.setattr(*seen)
    asked = ["0.3", "0.2", "0.25"], ["0.3", "--plane", "three-kicks:0.25", "0.2"]
    results = [invoke("ask", tmp_path, *words) for words in asked]
    output = {result.output.partition(": ")[2].partition("figures")[0] for result in results}
    assert len(output) == 1
    assert "a rotational invariant circle exists" in output.pop()
    assert kappas == [(0.3, 0.2, 0.25)] * 2
    assert len(list(tmp_path.glob("ask_*.png"))) == 2


def test_aperiodic_and_repeated_kicks_get_different_answers(tmp_path):
    kicks = str(tmp_path / "kicks.txt")
    np.savetxt(kicks, np.random.default_rng(1).uniform(1, 1.5, 70))
    output = invoke("ask", tmp_path, "--once", kicks).output
    assert "NO BARRIER survives these 70 kicks" in output
    assert (tmp_path / "ask_kicks.png").exists()
    repeated = invoke("ask", tmp_path, kicks).output
    assert "TRANSPORT at kappa of 70 kicks" in repeated
    assert "NO BARRIER" not in repeated
    np.savetxt(kicks, np.full(70, 0.9))
    output = invoke("ask", tmp_path, "--once", kicks).output
    assert "UNDECIDED for these 70 kicks" in output


@pytest.mark.parametrize(
    ("kappa", "name", "unit"),
    [
        ((0.9,), "kappa = 0.9", "per kick, and its images ±ω + n by"),
        ((0.5, 0.4), "kappa = (0.5, 0.4)", "per step of 2 kicks, and its images ±ω + 2n by"),
        (
            (0.3, 0.2, 0.25),
            "kappa = (0.3, 0.2, 0.25)",
            "per step of 3 kicks, and its images ±ω + 3n by",
        ),
    ],
)
def test_an_answer_names_its_forcing_and_the_unit_of_its_rotation_number(kappa, name, unit):
    first, circle, *_ = sentences(np.array(kappa), None, verdict(kappa))
    assert f"BARRIER at {name}: " in first
    assert unit in circle
    written, repeated, value, *_ = (word.strip(",") for word in circle.split(" = ")[1:])
    digits = [int(digit) for digit in re.findall(r"\d+", repeated)]
    assert finite(digits) == pytest.approx(float(parse(written)), abs=0.02)
    assert float(value.split()[0]) == pytest.approx(float(parse(written)), rel=1e-11)


def finite(digits):
    """Return the value of a finite continued fraction."""
    value = Fraction(digits[-1])
    for digit in digits[-2::-1]:
        value = digit + 1 / value
    return float(value)


@pytest.mark.parametrize("kappa", [(2.0,), (1.2, 0.9), (2.0, 0.0), (0.9, 0.4, 0.7, 0.4)])
def test_lifetimes_are_whole_numbers_of_kicks(kappa):
    result = verdict(kappa)
    (line,) = [line for line in sentences(np.array(kappa), None, result) if "eliminates" in line]
    (kicks,) = re.findall(r"after (\d+) kicks?\.", line)
    assert int(kicks) == result.steps * len(kappa) >= 1
    assert ("kicks" in line) == (int(kicks) > 1)


@pytest.mark.parametrize(
    ("lower", "upper", "texts"),
    [
        (0.450120942, 0.454658451, ("0.4501", "0.4547")),
        (1.42510154, 1.42652778, ("1.4251", "1.4266")),
        (0.99999, 1.0000123456, ("0.99999", "1.000013")),
        (1.0, 1.0132, ("1", "1.014")),
        (3.0, np.inf, ("3", "")),
        (np.nan, 0.4546584519, ("", "0.454659")),
        (9.123456e299, 9.234567e299, ("9.12e+299", "9.24e+299")),
        (0.25, 0.25, ("0.25", "0.25")),
        (np.nan, np.inf, ("", "")),
    ],
)
def test_a_bracket_is_rounded_outwards_to_digits_that_match_its_width(lower, upper, texts):
    boundary = CriticalScale(np.nan, np.nan, lower, upper, None, Status.OK)
    assert bracket_of(boundary) == texts


def drawn(kappa):
    return period.drawn(np.array(kappa), None, verdict(kappa), None)


def test_a_verdict_of_transport_is_drawn_as_dots_without_a_line():
    figure = drawn((1.0, 1.0))
    (output,) = [line for line in figure.axes[0].lines if "not a barrier" in line.get_label()]
    assert (output.get_ls(), output.get_mfc()) == ("None", "black")
    width = figure.axes[0].get_window_extent().width * 72 / figure.dpi
    assert output.get_xdata().size * output.get_ms() < 0.8 * width  # dots do not merge into a line
    assert all(line.get_ls() == "None" for line in figure.axes[0].lines)


def test_the_circle_is_drawn_over_the_whole_period():
    figure = drawn((0.3, 0.4))
    (circle,) = [line for line in figure.axes[0].lines if "certified" in line.get_label()]
    x, y = circle.get_data()
    assert x[0] <= 0 < 1 <= x[-1]
    assert (np.diff(x) > 0).all()
    assert (x[-2] - 1, y[-2]) == pytest.approx((x[0], y[0]))


@pytest.mark.slow
def test_where_a_circle_reappears_in_a_narrow_band_transport_is_not_claimed():
    residues = {}
    for scale in (0.6265, 0.62708, 0.6275):
        kappa = scale * np.array((1, 0.63, 1))
        fractions = list(islice(convergents("[0;1,2,1,2,1,3,3,4,4,1,4,1,1,12,(1)]"), 14))
        orbits = ConvergentOrbits(kappa, 0 * kappa, fractions)
        residues[scale] = [orbits.at(n, 0.0, -1).residue for n in range(14)]
    assert min(residues[0.6265][-1], residues[0.6275][-1]) > 1e50
    assert max(residues[0.62708][5:]) < 0.5
    assert residues[0.62708][-1] < 0.01
    assert verdict(0.62708 * np.array((1, 0.63, 1))).answer is not Answer.TRANSPORT


def test_a_table_states_if_no_scale_was_proved():
    result = verdict((0.3, 0.2))
    assert "barrier proved up to" not in result._repr_html_()
    assert "0.5 times the forcing" in replace(result, proved_below=0.5)._repr_html_()
    assert "no scale, in the time allowed" in replace(result, proved_below=0.0)._repr_html_()
