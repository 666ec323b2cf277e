"""Labelled forcings: splits, exact regions, indicator rules, scores and findings."""

from fractions import Fraction
from itertools import product

import numpy as np
import oracles
import pytest
import xarray as xr
from commands import invoke
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import binomtest

from nasm import barriers, escape, proofs
from nasm.numbers import parse
from nasm.planes import two_kicks
from nasm.proofs import cells as proved_cells
from nasm.symmetries import ray
from pipeline.cubes import indicators as of_cube
from pipeline.cubes import proved
from workflows.labels import regions, scoring, study

GAMMA = float(parse("gamma"))
MARGINS = [0.01, 0.1, 0.3]


def rays(angles, scale):
    columns = {"critical_scale": scale, "error": 1e-9 * scale, "circle": "gamma"}
    on = {name: ("angle", np.array(len(angles) * [value])) for name, value in columns.items()}
    return xr.Dataset(on, {"angle": angles})


@pytest.fixture(scope="module")
def drawn():
    return study.drawn(rays([5.0, 20.0, 40.0], 0.6), MARGINS, seed=3)


def test_each_ray_has_a_forcing_in_every_class_on_each_side(drawn):
    scale = np.hypot(drawn.kappa1, drawn.kappa2) / 0.6 - 1
    assert_allclose(scale, drawn.margin, atol=1e-14)
    angle = np.rad2deg(np.arctan2(drawn.kappa2, drawn.kappa1))
    places = zip(angle.round(9).values, np.sign(drawn.margin).values, strict=True)
    classes = np.digitize(abs(drawn.margin), MARGINS)
    assert sorted((*place, c) for place, c in zip(places, classes, strict=True)) == [
        *product([5.0, 20.0, 40.0], [-1.0, 1.0], [1, 2])
    ]


def test_images_have_the_same_canonical_form_and_the_same_split(drawn):
    kappa1, kappa2 = study.images(drawn)
    assert len({*np.sign(kappa1), *np.sign(kappa2)}) == 2
    for a, b, c, d in zip(kappa1, kappa2, drawn.kappa1.values, drawn.kappa2.values, strict=True):
        assert study.canonical(a, b) == (c, d)
        images = [(s * u, t * v) for u, v in ((c, d), (d, c)) for s in (-1, 1) for t in (-1, 1)]
        assert len({study.split_of(*image) for image in images}) == 1
    random = np.random.default_rng(1).random((2000, 2))
    share = np.mean([study.split_of(*pair) == study.TEST for pair in random])
    assert 0.45 < share < 0.55  # four standard deviations


def test_a_cell_contains_its_corners_and_no_float_beyond_them():
    _, (proof,) = proofs.proved_cells(
        two_kicks(), (0.75, 0.25), 0.0625, 0, [(0.0, 0.5), (45.0, 0.7)], 5.0
    )
    certificate = proof.certificate()
    name, covers = regions.square_of(certificate)
    assert name == certificate["sha256"]
    for kappa in product((0.75, 0.8125), (0.25, 0.3125)):
        assert covers(*kappa)
    assert not covers(np.nextafter(0.75, 0), 0.25)
    assert not covers(0.75, np.nextafter(0.3125, 1))


def test_a_patch_contains_exactly_the_forcings_its_statement_covers():
    numbers = {"kappa": (0.5, 0.1), "tilt": (0.0, 0.1), "scales": (0.25, 0.75)}
    fields = {key: [float(each).hex() for each in row] for key, row in numbers.items()}
    covers = regions.patch_of(fields)
    a, b = ([Fraction(each) for each in numbers[key]] for key in ("kappa", "tilt"))
    for s, t in product((0.25, 0.5, 0.75), (-1, 0, 0.5, 1)):
        exact = [Fraction(s) * (p + Fraction(t) * q) for p, q in zip(a, b, strict=True)]
        assert covers(*exact)
    for s, t in ((0.25 - 2**-40, 0), (0.75 + 2**-40, 0), (0.5, 1 + 2**-40), (0.5, -1 - 2**-40)):
        exact = [Fraction(s) * (p + Fraction(t) * q) for p, q in zip(a, b, strict=True)]
        assert not covers(*exact)


def one_forcing(kappa1, kappa2, margin, circle, seconds):
    """Return a tile of `proved_forcings` as computed, and its certificates."""
    job = proved.proved_forcings("labels_proofs", [(kappa1, kappa2, margin)], [circle])
    coords = {key: job.cube.template[key].values for key in job.cube.template.coords}
    arrays = job.compute(coords, {"seconds": seconds})
    certificates = proved.unpack_certificates(arrays.pop("certificates", b""))
    return job.cube.filled(arrays), certificates


def test_no_answer_is_proved_on_the_wrong_side_of_the_critical_scale():
    last = barriers.critical_scale(ray(33.0), 1e-2)
    for margin in (-0.05, 0.05):
        kappa = (1 + margin) * last.value * ray(33.0)
        right = proved.BARRIER if margin < 0 else proved_cells.TRANSPORT
        for tried, answer in ((margin, right), (-margin, proved_cells.OPEN)):
            tile, certificates = one_forcing(*kappa, tried, str(last.omega), 0.3)
            assert int(tile.proved[0]) == answer
            assert len(certificates) == (answer != proved_cells.OPEN)
            assert proved.uncertified_forcing(tile, certificates) == ""


def test_a_proved_forcing_needs_a_certificate_for_the_same_statement():
    tile, certificates = one_forcing(0.6, 0.0, 0.2, "gamma", 5.0)
    assert proved.uncertified_forcing(tile, certificates) == ""
    assert "no certificate" in proved.uncertified_forcing(tile, [])
    moved = tile.assign_coords(kappa1=tile.kappa1 + 1e-12)
    assert "no certificate" in proved.uncertified_forcing(moved, certificates)
    other = tile.assign(proved=tile.proved.copy(data=np.array([proved.BARRIER], np.int8)))
    assert "no certificate" in proved.uncertified_forcing(other, certificates)


def test_orbits_in_islands_are_locked_but_orbits_on_noble_circles_are_not():
    for n in (300, 3000, 30_000):
        assert of_cube.is_locked(np.array([n / 2 + 0.4, n / 3 - 0.2, 0.9]), n).all()
        for omega in (GAMMA, GAMMA**2, float(parse("[0;3,(1)]"))):
            assert not of_cube.is_locked(np.array([n * omega, n * omega + 0.3]), n).any()


def values_of(kappa, n, n_starts=16):
    settings = of_cube.IndicatorSettings(n_orbits=n_starts, n_starts=n_starts)
    job = of_cube.indicators("few", [kappa[0]], [kappa[1]], [n], settings)
    coords = {key: job.cube.template[key].values for key in ("forcing", "n", "kappa1", "kappa2")}

    def value(name):
        tile = coords | {"indicator": np.array([name])}
        return job.compute(tile, job.cube.settings)["value"].item()

    return {name: value(name) for name in of_cube.INDICATORS}


def test_without_kicks_indicators_have_exact_values():
    n = 400
    values, grown = values_of((0.0, 0.0), n), np.log(np.hypot(2 * n, 1))
    assert values["escape"] == np.inf
    assert values["digits"] > 12
    assert_allclose([n * values["exponent"], values["fli"]], grown, rtol=1e-12)


def test_the_escape_indicator_agrees_with_a_plain_loop_over_orbits():
    kappa, n = (5.0, 4.5), 60
    times = oracles.escape_time(kappa, *escape.ensemble(16), n)
    assert np.isfinite(times.min())
    assert values_of(kappa, n)["escape"] == times.min()


def test_strong_kicks_leave_no_orbit_that_looks_regular_and_rotational():
    values = values_of((7.0, 6.5), 500)
    assert values["digits"] == 0
    assert values["exponent"] > 0.5
    assert values["escape"] < 100


def test_orbits_look_more_regular_far_below_the_boundary_than_beyond_it():
    values, chaotic = values_of((0.3, 0.2), 1000), values_of((1.0, 0.9), 1000)
    assert values["digits"] > 8 > chaotic["digits"]
    assert values["exponent"] < chaotic["exponent"] / 2
    assert values["fli"] < chaotic["fli"] / 2


@pytest.mark.parametrize("larger", [True, False])
def test_no_other_threshold_has_a_smaller_error(larger):
    random = np.random.default_rng(5)
    is_barrier = random.random(60) < 0.4
    values = random.normal(size=60) + (1.5 if larger else -1.5) * is_barrier
    values[:3] = np.inf if larger else -np.inf

    def error(limit):
        answers = scoring.answers_barrier(values, limit, larger)
        return np.mean(~answers[is_barrier]) + np.mean(answers[~is_barrier])

    limit = scoring.threshold(values, is_barrier, larger)
    others = [*values, *(values[3:] + 1e-9), *(values[3:] - 1e-9)]
    assert error(limit) <= min(map(error, others)) + 1e-12


def test_intervals_agree_with_the_wilson_intervals_of_scipy():
    for k, n in ((0, 10), (3, 17), (25, 25)):
        expected = binomtest(k, n).proportion_ci(0.95, "wilson")
        assert_allclose(scoring.wilson(k, n), (expected.low, expected.high), atol=1e-4)
    assert np.isnan(scoring.wilson(0, 0)).all()


def labels_of(values, n=100):
    """Return a data set of 400 forcings in which every indicator has the same values.

    values : (is it a barrier?, margin) → value of a score that is large for barriers.
    """
    random = np.random.default_rng(8)
    is_barrier, margin = random.random(400) < 0.5, random.choice([0.02, 0.2], 400)
    score = np.array([values(*pair) for pair in zip(is_barrier, margin, strict=True)])
    columns = {
        "label": np.where(is_barrier, study.BARRIER, study.TRANSPORT),
        "split": np.where(random.random(400) < 0.5, study.TRAIN, study.TEST),
        "margin": np.where(is_barrier, -1, 1) * margin,
    }
    data = {name: ("forcing", column) for name, column in columns.items()}
    known = {"escape": np.where(score > 0.5, np.inf, 10.0), "digits": score}
    known |= {"exponent": -score, "fli": -score}
    data |= {name: (("forcing", "n"), column[:, None]) for name, column in known.items()}
    attrs = {"n_orbits": 8, "n_starts": 8, "drawn_below": 200, "drawn_beyond": 205}
    return xr.Dataset(data, {"n": [n], "forcing": np.arange(400)}, attrs)


def test_false_answers_are_counted_in_their_class_and_on_their_side():
    errs = labels_of(lambda barrier, margin: float(barrier or margin < 0.1))
    scores = scoring.scores(errs, MARGINS)
    wrong = scores.sel(side="beyond", margin_class=0)
    assert_array_equal(wrong.n_false, wrong.n_test)
    assert int(scores.n_false.sum()) == int(wrong.n_false.sum()) > 100
    test = (errs.split == study.TEST).sum()
    assert_array_equal(scores.n_test.sum(["side", "margin_class"]), int(test))
    assert_array_equal(scores.kicks.sel(indicator="fli"), 2 * 8 * 100)
    assert scores.attrs["unlabelled"] == 5


def verdicts(labels):
    """Return the verdicts on the two claims: the words that follow each of them."""
    scores = scoring.scores(labels, MARGINS)
    seconds = xr.DataArray(np.ones((4, 1)), dims=("indicator", "n"))
    lines = scoring.findings(scores, seconds).splitlines()[:2]
    return [line.partition(". ")[2].partition(":")[0] for line in lines]


def as_claimed():
    """Return labels for which each indicator errs exactly where the first claim says it does."""
    labels = labels_of(lambda barrier, margin: float(barrier))
    barrier, near = labels.label == study.BARRIER, abs(labels.margin) < 0.1
    wrong_beyond, wrong_below = ~barrier & near, barrier & near
    labels["escape"] = labels.escape.where(~wrong_beyond, np.inf)
    labels["digits"] = labels.digits.where(~wrong_below, 0.0)
    # For half of the forcings near the boundary, the values of the two kinds are swapped.
    mixed = near & (labels.forcing % 2 == 0)
    for name in ("exponent", "fli"):
        labels[name] = xr.where(mixed, -1 - labels[name], labels[name])
    return labels


def test_findings_hold_or_fail_according_to_the_answers():
    assert verdicts(as_claimed()) == ["Supported", "Supported"]
    right = labels_of(lambda barrier, margin: float(barrier))
    assert verdicts(right) == ["Not supported", "Not supported"]
    swapped = as_claimed()
    swapped["exponent"] = -swapped.digits
    assert verdicts(swapped) == ["Supported with a caveat", "Supported"]
    few = as_claimed().isel(forcing=slice(60))
    assert all(verdict.startswith("Not decided") for verdict in verdicts(few)[:1])


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--margins", "0.1"], "two or more increasing numbers"),
        (["--margins", "0.1,0.01"], "two or more increasing numbers"),
        (["--margins", "0.01,0.9"], "from 0.0003 to 0.5"),
        (["--n-max", "2,100"], "at least 4"),
    ],
)
def test_the_command_refuses_bad_margins_and_steps(options, reason, tmp_path):
    result = invoke("labels", tmp_path / "out", *options)
    assert result.exit_code == 2
    assert reason in " ".join(result.output.split())
    assert not (tmp_path / "out").exists()
