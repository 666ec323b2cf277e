"""The boundaries CB_ω: choice of the method, accuracy, and omission of uncertain points."""

from contextlib import suppress
from itertools import takewhile

import numpy as np
import pytest

from nasm import periodic
from nasm.action import LostError, ordered_orbits
from nasm.circles import hull
from nasm.converse_kam import symmetry_line
from nasm.numbers import convergents, parse
from nasm.planes import three_kicks, two_kicks
from nasm.results import Status
from nasm.symmetries import dominant_centre, ray
from pipeline.cubes import barrier, breakdown, escape
from pipeline.cubes.cube import status_code
from pipeline.sweep.grid import Axis
from workflows.figures import circle_boundaries, style
from workflows.figures.critical_boundary import draw_critical_boundary
from workflows.figures.rotating import draw_rotating_circles
from workflows.shared import rays

ANGLES = np.linspace(0, 180, 13)
SCALES = np.array([[0.4], [0.3]]) * np.ones(13)  # one row for each of two circles
DOUBTFUL = 1, 4  # indices of the point whose error is 5%


def on_rays(job, scales):
    """Return the Dataset of a cube whose circles break at these scales."""
    x, y = ray(ANGLES).T
    arrays = dict(zip(two_kicks().axes, (scales * x, scales * y), strict=True))
    arrays |= {"critical_scale": scales, "upper": scales, "error": 1e-3 * scales}
    arrays["method"] = np.ones(scales.shape, np.int8)
    return job.cube.filled(arrays).assign_attrs(job.cube.attributes).load()


@pytest.fixture(scope="module")
def cubes():
    omegas = [parse("gamma"), parse("2gamma")]
    circles = on_rays(breakdown.by_continuation(two_kicks(), omegas, ANGLES, 1e-4), SCALES)
    circles.error[DOUBTFUL] = 0.05 * SCALES[DOUBTFUL]
    field = escape.over_plane("", two_kicks(), (Axis(-1, 1, 8), Axis(0, 1, 4)), [8], 100, 4).cube
    times = np.full(field.template.escape_time.shape, np.inf)
    return {
        "circles": circles,
        "barrier": barrier.boundary(ANGLES, 0.1),
        "field": field.filled({"escape_time": times}).assign_attrs(field.attributes),
        "direct": on_rays(breakdown.by_escape(two_kicks(), ANGLES, 100, 8), 0.6 + 0 * SCALES[0]),
    }


FIGURES = {
    "main job": (draw_critical_boundary, "field", "circles", "barrier"),
    "circles": (circle_boundaries.draw_circle_boundaries, "circles", "barrier"),
    "cusps": (circle_boundaries.draw_tips, "circles", "circles", "barrier"),
    "rotating": (draw_rotating_circles, "circles", "barrier", "direct"),
}


@pytest.mark.parametrize("name", FIGURES)
def test_nothing_is_drawn_where_the_error_is_above_two_percent(name, cubes):
    draw, *data = FIGURES[name]
    with style.sheet():
        figure = draw(*(cubes[key] for key in data))
    drawn = [line.get_xydata() for axes in figure.axes for line in axes.lines]
    points, places = np.vstack(drawn), SCALES[..., None] * ray(ANGLES)
    away = np.linalg.norm(points - places[:, :, None], axis=-1)
    seen = np.nanmin(away, axis=-1) < 1e-9
    assert [*zip(*np.nonzero(~seen), strict=True)] == [DOUBTFUL]


def test_a_circle_and_its_image_do_not_look_alike(cubes):
    image = cubes["circles"].assign_coords(circle=["[0;(1)]", "[0;2,(1)]"])
    figure = circle_boundaries.draw_circle_boundaries(image, cubes["barrier"])
    one, other = figure.axes[0].lines
    assert (one.get_color(), one.get_linestyle()) != (other.get_color(), other.get_linestyle())


def test_the_caption_states_the_worst_error_drawn_and_what_is_left_out(cubes):
    text = circle_boundaries.describe_circles(cubes["circles"])
    assert "25 points by continuation to an error of 0.0001" in text
    assert "largest error drawn is 0.1% of the scale" in text
    assert "above 2%): 1 of 26" in text


def computed(plane, circles, angles, job=breakdown.by_continuation, effort=1e-4):
    """Return the cube of these circles, computed in this process, with its attributes."""
    cube = (job := job(plane, list(map(parse, circles)), angles, effort)).cube
    known = {"circle": cube.template.circle.values, "angle": np.asarray(angles)}
    return cube.filled(job.compute(known, cube.settings)).assign_attrs(cube.attributes)


def test_residues_are_used_where_continuation_misses_the_tolerance():
    result = computed(two_kicks(), ["2gamma"], [30.0, 134.722])
    assert style.has_flag(result.method, "continuation").values.tolist() == [[True, False]]
    assert style.has_flag(result.method, "residue").values.tolist() == [[False, True]]
    assert (result.error <= 1e-4).all()
    assert set(result.method.attrs["flag_meanings"].split()) >= {"continuation", "residue"}
    judge(result)


def test_if_all_methods_fail_the_status_is_from_the_first():
    result = computed(two_kicks(), [f"[0;2,{10**9},(1)]"], [0.0])
    assert result.status == status_code(Status.NEARLY_RATIONAL)
    assert style.has_flag(result.method, "continuation")
    assert result.critical_scale.isnull()


def test_in_a_plane_with_a_nonzero_origin_only_residues_are_used():
    result = computed(three_kicks(0.2), ["gamma"], [45.0], breakdown.by_residue, 100)
    assert style.has_flag(result.method, "residue")


@pytest.mark.slow
def test_the_circles_of_the_main_job_are_right_on_all_rays():
    """Rays from 0 to 90 degrees are enough, because all other rays are images of these."""
    angles = rays.ray_angles(two_kicks(), 181, 8)
    result = computed(two_kicks(), map(str, rays.PAPER_CIRCLES), angles[angles <= 90])
    assert (result.error <= 1e-4).all()
    assert style.has_flag(result.method, "continuation").mean() > 0.7
    judge(result)


# Relative distances below the breakup at which circles are certified; the larger one is for cusps.
AWAY = 1e-3, 1e-2


def judge(found):
    """Check that all points are right within their errors.

    Points found by continuation are compared with residues. For points found by residues, a circle
    must be certified just below the breakup, and converse KAM must exclude it just above.
    """
    by_residue = style.has_flag(found.method, "residue").values
    for place in np.ndindex(found.critical_scale.shape):
        omega, profile = parse(found.circle.values[place[0]]), ray(found.angle.values[place[1]])
        value, error = (float(found[name].values[place]) for name in ("critical_scale", "error"))
        where = str(omega), float(found.angle[place[1]])
        if by_residue[place]:
            nearest = (hull.certified_circle(omega, profile, value, d)[0] for d in AWAY)
            assert 0.985 * value < np.nanmax([*nearest]) < value + error, where
            above = [(1 + d) * value + 2 * error for d in (1e-3, 3e-3)]
            assert any(no_circle(omega, scale * profile) for scale in above), where
        else:
            judged = periodic.critical_scale(omega, profile)
            assert judged.status is Status.OK, where
            assert abs(value - judged.value) <= error + judged.error, where


def no_circle(omega, kappa):
    """Return True if converse KAM excludes a circle of rotation number ω.

    It must eliminate all starts at which the circle could cross the dominant line. These starts lie
    between orbits with lower and higher rotation numbers.
    """
    low, high, (site, a) = [], [], dominant_centre(kappa)
    for fraction in takewhile(lambda f: f.denominator < 400, convergents(omega)):
        with suppress(LostError):
            _, orbit = ordered_orbits(kappa, fraction.numerator, fraction.denominator)
            x = orbit.sites()
            y = np.diff(x, prepend=x[-1] - fraction.numerator)
            at_site = (orbit.site + np.arange(x.size)) % kappa.size == site
            on_line = at_site & (abs(x - a - np.rint(x - a)) < 1e-9)
            (low if fraction < float(omega) else high).extend(y[on_line])
    assert max(low) < min(high)
    starts = np.linspace(max(low), min(high), 400)
    return np.isfinite(symmetry_line.elimination_time(kappa, starts, 20_000)).all()
