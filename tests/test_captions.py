"""Captions for sparse results contain no nan and give percentages in plain digits."""

import numpy as np
import pytest
import xarray as xr

from nasm.planes import two_kicks
from nasm.symmetries import ray
from pipeline.cubes import beyond
from pipeline.cubes.barrier import boundary
from pipeline.cubes.proved import everywhere, proved_map, proved_triangles
from pipeline.cubes.rotating_maps import breakups
from workflows.convergence.study import on_the_diagonal
from workflows.figures.convergence import diagonal_caption
from workflows.figures.flux import flux_caption
from workflows.figures.proved_map import draw_proved_map, proved_map_caption
from workflows.figures.tori import breakups_caption
from workflows.flux import study as flux
from workflows.shared.boundary_captions import describe_boundary, describe_direct_iteration
from workflows.shared.direct_iteration import exponent


@pytest.mark.parametrize(
    ("away", "expected"), [(0.02, "within 1."), (0.1, "within 10"), (9, "No cell is open")]
)
def test_the_proved_map_caption_gives_distances_in_percent(away, expected, monkeypatch):
    angles = np.array([0.0, 45.0])
    kappa1, kappa2 = 0.5 * ray(angles).T
    known = {"angle": angles, "critical_scale": ("angle", [0.5, 0.5])}
    known |= {"kappa1": ("angle", kappa1), "kappa2": ("angle", kappa2)}
    rays = [(0.0, 0.5), (45.0, 0.5)]
    cube = proved_map(two_kicks(), rays, 64, 1.0).cube
    triangles = proved_triangles(two_kicks(), rays, [""] * 2, 0.1).cube
    scale = np.hypot(*np.meshgrid(cube.template.kappa1, cube.template.kappa2)) / 0.5
    proved = np.where(scale > 1, 2, 1)
    if away < 1:
        proved[np.abs(scale - 1 - away) < 0.01] = 1
    filled = cube.filled({"proved": proved})
    (low, high, _), *rest = triangles.settings["triangles"]
    assert not rest
    sides = {
        f"kappa{i}_{end}": x[i - 1] for end, x in (("low", low), ("high", high)) for i in (1, 2)
    }
    numbers = {key: ("triangle", [x]) for key, x in (sides | {"proved_below": 0.9}).items()}
    within = triangles.template.assign(numbers)
    barrier = xr.Dataset(known, attrs=two_kicks().record)
    filled = filled.assign_attrs(cube.attributes)
    whole, reach = everywhere(filled, barrier), float(filled.kappa1[-1]) + 0.5 / 64
    monkeypatch.setattr("pipeline.cubes.proved._BLOCK_CELLS", 1000)
    xr.testing.assert_identical(everywhere(filled, barrier), whole)
    caption = proved_map_caption(whole, within, barrier)
    assert expected in caption
    assert "to within 10% of CB_gt on half of its rays" in caption
    assert "e+0" not in caption
    assert "Inset" not in caption
    axes = draw_proved_map(whole, within, barrier).axes[0]
    assert not axes.child_axes
    # All four quadrants are drawn, to the ends of the outermost cells.
    assert axes.get_xlim() == axes.get_ylim() == (-reach, reach)
    assert axes.images[0].get_extent() == [-reach, reach, -reach, reach]
    assert (axes.images[0].get_array() == whole.proved.values).all()
    monkeypatch.setattr("workflows.figures.proved_map._MAX_DRAWN", 60)
    (image,) = draw_proved_map(whole, within, barrier).axes[0].images
    assert image.get_array().shape == (40, 40)  # every second cell of 80
    assert image.get_extent() == [-reach, reach, -reach, reach]
    finer = whole.assign_attrs(cells=1024)
    (inset,) = draw_proved_map(finer, within, barrier).axes[0].child_axes
    assert np.hypot(np.mean(inset.get_xlim()), np.mean(inset.get_ylim())) == pytest.approx(0.5)
    assert "Inset: the open cells on one ray" in proved_map_caption(finer, within, barrier)


def test_a_flux_law_that_cannot_be_fitted_is_reported_as_no_fit():
    excesses = np.geomspace(0.1, 0.5, 5)
    circles = dict.fromkeys([0.0, 30.0], "[0;(1)]")
    cube = beyond.flux(two_kicks(), dict.fromkeys(circles, 1.0), circles, excesses, 100).cube
    values = np.tile(1e-3 * excesses**3, (2, 1))
    filled = cube.filled({"flux": values}).assign(q_max=100)
    caption = flux_caption(filled.assign_attrs(q_max=100), flux.laws(filled))
    assert "no fit at 30°, because there are too few distances" in caption
    assert "nan" not in caption


def test_captions_of_tori_and_boundaries_without_results_say_so():
    tori = breakups([(0.22, 0.618)], [30.0], 0.1).cube.template.load()
    caption = breakups_caption(tori)
    assert "rays; none found" in caption
    result = boundary([0.0, 45.0], 0.1, two_kicks())
    nothing = result.assign({name: result[name] * np.nan for name in ("lower", "upper")})
    assert "No ray has a bracket" in describe_boundary(nothing)
    assert "nan" not in caption + describe_boundary(nothing)


def test_no_power_law_is_fitted_to_too_few_or_increasing_biases():
    n = 100.0 * 2 ** np.arange(8)
    law = 0.3 * n ** (-1 / 3)
    few = np.where(n < 600, law, np.nan)
    for biases in (few, law[::-1]):
        assert np.isnan(exponent(n, biases)).all()
    coords = {"ensemble": [10], "angle": [45.0], "n": n}
    bias = xr.DataArray(few[None, None], coords, ("ensemble", "angle", "n"))
    caption = diagonal_caption(on_the_diagonal(bias, 1.374))
    assert "η = not found for N up to" in caption
    assert "nan" not in caption


def test_the_caption_for_a_plane_without_transport_says_so():
    dims = {"n": [100], "angle": [0.0, 45.0]}
    scale = xr.DataArray(np.full((1, 2), np.nan), dims, ("n", "angle"))
    barrier = xr.Dataset({"critical_scale": ("angle", [0.486, 1.374])}, {"angle": dims["angle"]})
    text = describe_direct_iteration(scale.to_dataset(name="critical_scale"), barrier, 10)
    assert "no transport in this plane" in text
    assert "nan" not in text
