"""Two series of kicks: symmetries of the delay, resonances, and the judgement of findings."""

import re
from fractions import Fraction
from math import nan

import numpy as np
import pytest
from cases import thirds
from commands import invoke
from figure_faults import faults
from oracles import KAPPA_G

from nasm import barriers, numbers, periodic
from nasm.planes import pairs
from nasm.results import CriticalScale, Status, no_answer
from nasm.symmetries import equivalent_forcings
from pipeline.cubes.barrier import circle_arrays, last_barrier, unfolded
from pipeline.cubes.breakdown import scale_fields
from pipeline.cubes.forcings import last_barriers
from workflows.figures import style
from workflows.figures.two_series import draw_planes, draw_thresholds, planes_caption
from workflows.shared.fractions import up_to_half
from workflows.two_series import study

OF_A_DELAY = pytest.mark.parametrize("delay", ["1/2", "1/3", "1/4", "2/5", "3/8"])


def shifts_of(plane, first, second):
    """Return the shifts of ω by symmetries that map the plane's forcings to a·first + b·second."""
    vectors = np.array([plane.first, plane.second])
    images = equivalent_forcings(vectors)
    return {shift for shift, image in images if (image == [first, second]).all()}


@OF_A_DELAY
def test_delays_that_add_up_to_a_period_are_equivalent(delay):
    plane, other = pairs(delay), pairs(1 - Fraction(delay))
    assert 0 in shifts_of(plane, other.first, other.second)


@OF_A_DELAY
def test_an_image_is_equivalent_to_the_forcing_computed_in_its_place(delay):
    plane, q = pairs(delay), Fraction(delay).denominator
    assert study.computed_ratio(Fraction(delay), -1.0) == ((1.0, q // 2) if q % 2 == 0 else (-1, 0))
    assert (q // 2 in shifts_of(plane, plane.first, np.negative(plane.second))) == (q % 2 == 0)


def test_the_rotation_number_of_an_image_is_q_over_2_minus_omega():
    omega = numbers.parse("[0;2,2,(1)]")
    image = numbers.moebius(omega, -1, 2)
    equal, opposite = (pairs("1/4").forcing(1.0, r) for r in (1.0, -1.0))
    scale = periodic.critical_scale(omega, equal, 1500)
    assert scale.status is Status.OK
    assert periodic.critical_scale(image, opposite, 1500).value == pytest.approx(scale.value)


@pytest.mark.parametrize("delay", ["1/3", "2/5", "1/4"])
@pytest.mark.parametrize("ratio", study.RATIOS.values())
def test_resonances_have_the_strength_that_the_command_states(delay, ratio):
    """A standard map of strength S has |R| = S/4 for its period-one orbits."""
    K, q = 0.01, Fraction(delay).denominator
    kappa = pairs(delay).forcing(K, ratio * K)
    residues = [abs(periodic.residue(kappa, k, 1)) for k in range(q)]
    expected = K * abs(1 + ratio * np.exp(2j * np.pi * np.arange(q) * float(Fraction(delay))))
    assert 4 * np.array(residues) == pytest.approx(expected, abs=3 * K**2)
    weakest = study.weakest_resonance(Fraction(delay), ratio)
    assert K * weakest == pytest.approx(expected.min(), abs=1e-14)
    assert study.weakest_resonance(float(Fraction(delay)), ratio, q // 2) == weakest


def test_wider_windows_contain_weaker_resonances_at_an_irrational_delay():
    tau = float(numbers.parse(study.IRRATIONAL))
    seen = [study.weakest_resonance(tau, 1.0, n) for n in (0, 1, 4, 17, 72, 305)]
    assert seen == sorted(seen, reverse=True)
    assert seen[0] == 2
    assert seen[-1] < 0.01


def table_of(scale, max_denominator=5):
    """Return the table of thresholds K_c = scale(τ, r), with brackets 0.2% wide."""
    delays = up_to_half(max_denominator)
    job = last_barriers("two_series_forcings", study.forcings(delays), study.PARAMETER, 1e-3)
    answers, omega = [], numbers.parse("[0;2,(1)]")
    ratios = {f"K_α = {name}": ratio for name, ratio in study.RATIOS.items()}
    labels = job.cube.template
    for family, tau in zip(labels.family.values, labels.parameter.values, strict=True):
        K = scale(Fraction(tau).limit_denominator(64), ratios[family])
        known = CriticalScale(K, 1e-9, 0.999 * K, 1.001 * K, omega, Status.OK, "")
        answers.append(known if K == K else no_answer(None, Status.NOT_CONVERGED))
    return study.thresholds(job.cube.filled(scale_fields(answers) | circle_arrays(answers)), delays)


def test_a_table_of_thresholds_contains_images_with_their_own_circles():
    table = table_of(lambda tau, ratio: tau.denominator + ratio)
    values = table.critical_scale.to_pandas()
    assert list(map(str, values.index)) == ["1/5", "1/4", "1/3", "2/5", "1/2"]
    assert values[1.0].tolist() == [6, 5, 4, 6, 3]
    assert values[-1.0].tolist() == [4, 5, 2, 4, 3]  # the same as for +1 if q is even
    quarter, image = table.sel(delay="1/4"), numbers.moebius("[0;2,(1)]", -1, 2)
    assert quarter.circle.values.tolist() == ["[0;2,(1)]", "[0;2,(1)]", str(image)]
    assert quarter.omega.values[2] == pytest.approx(float(image))


def by_strength(sign):
    return lambda tau, ratio: 3 + sign * study.weakest_resonance(tau, ratio)


def test_the_findings_are_judged_from_the_brackets():
    falling = by_strength(-1)
    assert ". Supported: " in study.findings(table_of(falling))
    odd = table_of(lambda tau, ratio: 2.9 if tau == Fraction(1, 5) else falling(tau, ratio))
    said = study.findings(odd)
    assert "Supported with a caveat: " in said
    assert "lowest there in 2 of 2 cases" in said
    assert "Not supported: " in study.findings(table_of(by_strength(1)))
    unknown = table_of(lambda tau, ratio: nan if tau == Fraction(1, 3) else falling(tau, ratio))
    assert "Not supported: " in study.findings(unknown)  # 1/3 is not shown to be lowest
    nothing = study.findings(table_of(lambda *_: nan))
    assert "Not decided" in nothing
    assert not re.search(r"\bnan\b", nothing)
    assert "Not decided" in study.findings(table_of(falling, max_denominator=2))


@pytest.mark.parametrize("column", [pytest.param(False, marks=pytest.mark.slow), True])
def test_thresholds_and_panels_are_legible(column):
    def scale(tau, ratio):
        return nan if tau == Fraction(2, 7) else by_strength(-1)(tau, ratio)

    table = table_of(scale, max_denominator=16)
    angles, curves = np.linspace(0, 180, 13), []
    for delay in ("1/5", "1/4", "1/3", "1/2"):
        cube = last_barrier(pairs(delay), angles, 0.1).cube
        n = cube.template.angle.size
        omega = numbers.parse("[0;2,2,(1)]")
        brackets = [CriticalScale(2.0, 1e-9, 1.9, 2.1, omega, Status.OK, "")] * n
        axes = {name: np.ones(n) for name in pairs(delay).axes}
        filled = cube.filled(scale_fields(brackets) | circle_arrays(brackets) | axes)
        curves.append(unfolded(filled.assign_attrs(cube.attributes), angles))
    with style.sheet(column):
        for figure in (draw_thresholds(table), draw_planes(*curves)):
            style.finish(figure)
            assert faults(figure) == []
    said = planes_caption(curves)
    assert "τ = 1/5: 13 of 13 rays have a value, brackets at most 10% wide" in said
    assert "CB_gt meets the axes, where the map is the standard map, at 2. " in said


@pytest.mark.parametrize("delay", thirds(["1/2", "1/4", "3/8", "1/3", "2/5"]))
def test_one_series_alone_has_the_threshold_of_the_standard_map(delay):
    result = barriers.critical_scale(pairs(delay).forcing(1.0, 0.0), 1e-2)
    assert abs(result.value - KAPPA_G) <= result.error + 1e-12


@pytest.mark.parametrize("delay", ["1", "3/2", "1/65", "0.3x"])
def test_a_delay_must_be_a_proper_fraction_with_a_small_denominator(delay, tmp_path):
    ended = invoke("two_series", tmp_path / "out", "--delay", delay)
    assert ended.exit_code == 2
    assert f"delay={delay}" in ended.output.replace("'", "")
    assert not (tmp_path / "out").exists()


# K_c and its error, computed as q times the critical scale of the forcing without its factor 1/q.
FIRST = {
    ("1/2", 1.0): (1.943271, 5e-7),
    ("1/2", 0.5): (1.158455, 5e-7),
    ("1/3", 1.0): (0.903823, 5e-7),
    ("1/4", 0.5): (1.249533, 5e-7),
    ("2/5", 0.5): (1.093855, 5e-7),
    ("1/3", -1.0): (1.983, 1.2e-3),
}


@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=[pytest.mark.slow] * (case[0] != "1/2")) for case in FIRST]
)
def test_thresholds_agree_with_known_values(case):
    delay, ratio = case
    value, error = FIRST[case]
    found = barriers.critical_scale(pairs(delay).forcing(1.0, ratio), 1e-3)
    assert abs(found.value - value) <= error + found.error
