"""Spectrum of a ripple: small divisors, the limit of slow ripples, and how claims are judged."""

from fractions import Fraction

import numpy as np
import pytest
import xarray as xr
from oracles import KAPPA_G

from nasm import circles
from nasm.circles import fourier
from nasm.maps import rotating_forcing
from nasm.numbers import parse
from pipeline.cubes import rotating_maps
from workflows.figures.ripple_spectrum import draw_ripple_spectrum
from workflows.ripple_spectrum import small_divisors, study
from workflows.shared.fractions import up_to_half

GAMMA = float(parse("gamma"))


def test_the_response_is_the_derivative_of_circles_under_a_weak_ripple():
    """Two phases of a ripple of period three yield the real and the imaginary part of w'."""
    kappa, d = 0.5, 1e-4
    plain = circles.invariant_circle("gamma", kappa)
    n = 4 * plain.u.shape[1]
    slope = 1 + fourier.derivative(fourier.resample(plain.u[0], n))
    parts = []
    for phase in (0, -0.25):
        forcings = (rotating_forcing(kappa, sign * d * kappa, "1/3", phase) for sign in (1, -1))
        found = (circles.invariant_circle("3gamma", forcing).u[0] for forcing in forcings)
        up, down = (fourier.resample(u, n) for u in found)
        parts.append(fourier.derivative((up - down) / (2 * d * slope)))
    (found,) = small_divisors.strain(plain.u[0], GAMMA, kappa, [1 / 3])
    assert found == pytest.approx(np.hypot(*parts).max(), rel=1e-3)


@pytest.mark.parametrize("mode", [1, 2, 3])
def test_the_response_resonates_where_the_frequency_is_a_multiple_of_omega(mode):
    """The small divisor enters squared: at half the distance from resonance, w' is quadrupled."""
    u = circles.invariant_circle("gamma", 0.3).u[0]
    near, nearer = small_divisors.strain(u, GAMMA, 0.3, mode * GAMMA + np.array([2e-5, 1e-5]))
    assert nearer / near == pytest.approx(4, rel=1e-2)


def test_the_bound_for_slow_ripples_grows_from_one_with_frequency():
    frequency = np.geomspace(1e-8, 0.5, 50)
    for depth in (0.03, 0.3, 1):
        bound = study.adiabatic_bound(frequency, depth)
        assert (np.diff(bound) >= -1e-12).all()
        assert 1 < bound[0] < 1.01


def test_a_ripple_of_period_two_is_a_forcing_from_the_paper():
    """With Ω = 1/2 and d = 1 the forcing is (2κ, 0): every second kick is missing."""
    coords = {"fraction": ["1/2"], "depth": np.array([1.0])}
    found = rotating_maps._ripples(coords, {"tol": 1e-3})
    # In two kicks, y changes by 2κ/2π and x by 2y: this is the standard map with 4κ.
    assert found["critical_scale"][0, 0] == pytest.approx(KAPPA_G / 4, rel=1e-9)
    assert found["omega"][0, 0] == pytest.approx((3 - 5**0.5) / 4, abs=1e-12)


def test_fractions_are_listed_once_and_in_order():
    listed = up_to_half(4, [Fraction(1, 200), Fraction(1, 3)])
    assert [*map(str, listed)] == ["1/200", "1/4", "1/3", "1/2"]


FREQUENCIES = [0.005, 0.01, 0.2, 0.3, 0.4]


def results(loss, upper, predicted=(0.2, 0.25, 0.1, 0.3, 0.2)):
    """Return the cube and the theory for five frequencies, the first two of which are slow.

    Both depths have the same values, so there are eight steps between neighbouring frequencies. By
    chance, all of them would agree with the theory in one case out of 256.

    loss : the loss at each frequency; NaN where only an upper bound is known. upper : the bounds at
    the two slow frequencies, relative to κ_G/(1 + d).
    """
    dims, scale = ("frequency", "depth"), (1 - np.array(loss)) * KAPPA_G
    ends = scale * 1.001
    ends[:2] = np.array(upper) * KAPPA_G / 1.3
    coords = {"frequency": FREQUENCIES, "depth": [0.3, 0.31]}
    values = {"critical_scale": scale, "lower": scale * 0.999, "upper": ends}
    cube = xr.Dataset(
        {name: (dims, np.stack([row, row], 1)) for name, row in values.items()}, coords
    )
    cube = cube.assign_coords(fraction=("frequency", [*map(str, FREQUENCIES)]))
    theory = {"predicted_loss": predicted, "predicted_omega": 5 * [0.38]}
    theory["adiabatic_loss"] = [0.2, 0.1, -1, -1, -1]
    rows = {name: (dims, np.stack([row, row], 1)) for name, row in theory.items()}
    rows["resonance"] = "mode", [0.382, 0.236]
    return study.with_loss(cube, KAPPA_G), xr.Dataset(rows, coords | {"mode": [1, 2]})


@pytest.mark.parametrize(
    ("loss", "upper", "verdicts"),
    [
        ((0.2, 0.25, 0.1, 0.3, 0.2), (1.05, 1.02), ("Supported", "Supported")),
        ((0.2, 0.25, 0.3, 0.1, 0.2), (0.99, 1.02), ("Not supported", "Not supported")),
        ((0.1, 0.25, 0.1, 0.3, 0.2), (1.05, 1.02), ("Supported", "Not supported")),
        (5 * [np.nan], (1.05, 1.02), ("Not decided", "Supported")),
        (5 * [np.nan], (np.nan, np.nan), ("Not decided", "Not decided")),
    ],
)
def test_findings_are_judged_by_the_numbers(loss, upper, verdicts):
    said = study.findings(*results(loss, upper))
    claims = [part.split(".")[1].partition(":")[0].strip() for part in said.split("Claim: ")[1:]]
    assert tuple(claims) == verdicts


def test_arrows_are_drawn_only_where_nothing_but_a_bound_is_known():
    figure = draw_ripple_spectrum(*results((np.nan, 0.25, 0.1, 0.3, 0.2), (1.05, 1.02)))
    for axes, marker in zip(figure.axes, "^v", strict=True):
        arrows = [line for line in axes.lines if line.get_marker() == marker]
        assert [[*line.get_xdata()] for line in arrows if len(line.get_xdata())] == 2 * [[0.005]]


@pytest.mark.slow
def test_above_64_kicks_per_period_only_an_upper_bound_is_known():
    job = rotating_maps.ripples([Fraction(1, 65)], [0.3], 0.1)
    found = job.compute({"fraction": ["1/65"], "depth": np.array([0.3])}, job.cube.settings)
    assert np.isnan([found[name].item() for name in ("critical_scale", "lower", "omega")]).all()
    bound = study.adiabatic_bound(1 / 65, 0.3)
    assert 0.5 < found["upper"].item() * 1.3 / KAPPA_G < bound * 1.1
