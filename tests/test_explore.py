"""The explorer without a browser: its views, its state in the URL, and its answers to requests."""

import asyncio
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
import webbrowser
from concurrent.futures import Future, ThreadPoolExecutor
from fractions import Fraction
from math import inf, nan
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import parse_qsl

import numpy as np
import psutil
import pytest
import toy
from bokeh.server.util import bind_sockets
from commands import invoke
from dask.system import CPU_COUNT
from tornado.httpclient import AsyncHTTPClient

from nasm import action, barriers, diffusion, escape
from nasm.numbers import parse
from nasm.planes import pairs, rotating, three_kicks, two_kicks
from nasm.verdicts import Answer, verdict
from pipeline.cubes import barrier
from pipeline.store import Refused
from workflows.explore import field, plane, rays, server
from workflows.explore.field import Field, View
from workflows.explore.rays import Breakup, Rays
from workflows.explore.state import State
from workflows.explore.work import Work, spread
from workflows.figures.style import circle_style
from workflows.shared import on_demand, phase_space
from workflows.shared.orbit_sentences import describe_orbit
from workflows.shared.places import place_of


def escapes(view, row, column, steps):
    """Return n* at one pixel of a view in the plane of two kicks."""
    kappa = [
        low + (i + 0.5) * (high - low) / n
        for i, n, (low, high) in ((column, view.shape[1], view.a), (row, view.shape[0], view.b))
    ]
    x, y = escape.ensemble(field.ORBITS)
    return escape.first_escape(kappa, x, y, [x.size], steps, precision="single")[0]


def pictures(view, steps, fields=()):
    """Return all pictures of a view with their block sizes, and the number of forcings computed."""
    tree, n_forcings = field.Quadtree(two_kicks(), view, steps, list(fields)), 0
    results = [tree.picture()]
    for calls in tree.rounds():
        for cells, function, forcings, n in calls:
            n_forcings += len(cells)
            tree.accept(cells, function(forcings, n))
        results.append(tree.picture())
    return results, n_forcings


# The boundary for N = 300 crosses both views.
VIEW = View((0.8, 1.1), (0.0, 0.3), (54, 54))
NEAR = View((0.96995, 0.97005), (0.09995, 0.10005), (54, 54))


@pytest.mark.parametrize("view", [VIEW, NEAR])
def test_escaping_pixels_and_boundary_pixels_are_computed_individually(view):
    result, n_forcings = pictures(view, 300)
    times, block = result[-1]
    assert block == 1
    assert n_forcings < times.size
    assert 0.1 < np.isinf(times).mean() < 0.9
    random = np.random.default_rng(1)
    near = field._at_boundary(times, 300) | (times <= 300)
    for row, column in random.permutation(np.argwhere(near))[:40]:
        assert times[row, column] == escapes(view, row, column, 300)
    assert [blocks for _, blocks in result] == sorted((b for _, b in result), reverse=True)


def test_expensive_pixels_are_computed_only_along_the_boundary(monkeypatch):
    beyond = View((0.9, 1.2), (0.0, 0.3), VIEW.shape)
    every, n_forcings = pictures(beyond, 300)
    own = every[-1][0]
    monkeypatch.setattr(field, "_SPARE", 0.0)
    result, spared = pictures(beyond, 300)
    times = result[-1][0]
    assert spared < 0.8 * n_forcings
    near = field._at_boundary(times, 300)
    assert 100 < near.sum() < 0.5 * near.size
    assert (times == own)[near].all()
    blocks, apart = (x.reshape(18, 3, 18, 3) for x in (times, ~near))
    alike = (blocks == blocks[:, 1:2, :, 1:2]).all(axis=(1, 3))
    # Away from the boundary, the pixels in a block share one escape time.
    assert alike[apart.all(axis=(1, 3))].mean() > 0.9
    # For fewer steps the boundary is elsewhere, so its pixels are not among the known ones.
    known = Field(*beyond.centres(), times, 300, apart=3)
    fewer = pictures(beyond, 200, [known])[0][-1][0]
    np.testing.assert_array_equal(fewer, pictures(beyond, 200)[0][-1][0])


def test_a_late_escape_at_the_centre_of_a_block_is_kept():
    view = View((0.72, 0.78), (0.02, 0.08), (81, 81))
    (times, *_), middle = pictures(view, 4000)[0][-1], range(13, 81, 27)
    own = np.array([[escapes(view, row, column, 4000) for column in middle] for row in middle])
    assert ((own > 1000) & (own <= 4000)).sum() > 2
    np.testing.assert_array_equal(times[np.ix_(middle, middle)], own)


def test_mirror_images_in_the_plane_are_computed_once():
    view = View((-1.1, 1.1), (-1.1, 1.1), (108, 108))
    result, n_forcings = pictures(view, 400)
    times = result[-1][0]
    assert (times == times.T).all()
    assert (times == times[::-1]).all()
    assert n_forcings < 0.2 * times.size
    row, column = np.argwhere(times <= 400)[7]
    image = sorted((abs(row - 53.5), abs(column - 53.5)))  # the image between 0 and 45 degrees
    assert times[row, column] == escapes(view, *(np.array(image) + 53.5).astype(int), 400)


def test_known_pixels_are_not_computed_again():
    times, *_ = pictures(VIEW, 300)[0][-1]
    known = Field(*VIEW.centres(), times, 300)
    _, n_forcings = pictures(VIEW, 300, [known])
    assert n_forcings == 0
    _, n_forcings = pictures(VIEW, 100, [known])  # the pixels are known for fewer steps too
    assert n_forcings == 0
    moved = View((0.85, 1.15), (0.0, 0.3), (54, 54))
    (first, *_), n_forcings = pictures(moved, 300, [known])
    assert (first[0][:, :45] == times[:, 9:]).mean() > 0.97
    assert 0 < n_forcings < 0.35 * times.size
    nearer = View((0.95, 0.96), (0.1, 0.11), (54, 54))  # a preview is shown before the full picture
    result, n_forcings = pictures(nearer, 300, [known])
    assert not np.isnan(result[0][0]).any()
    assert n_forcings > 1000


def test_the_page_shows_nothing_from_a_refused_store_and_says_why(store, tmp_path):
    shutil.copytree(store / "escape.zarr", tmp_path / "escape.zarr")
    path = tmp_path / "escape.zarr" / "zarr.json"
    metadata = path.read_text()
    without_plane = metadata.replace('"plane"', '"other"')
    for changed, words in ((metadata[:-9], "are damaged"), (without_plane, "another program")):
        path.write_text(changed)
        opened = plane._cubes(place_of(tmp_path), two_kicks())
        assert next(opened) == ([], None)
        with pytest.raises(Refused, match=words):
            next(opened)


def test_coarse_cells_of_a_refined_cube_are_shown_as_a_preview(store):
    ((own, preview), _), *_ = plane._cubes(place_of(str(store)), two_kicks())
    view = View((-2, 2), (-2, 2), (64, 64))
    times, width = own.on(view, 300)
    assert width <= own.stays
    a, b = view.centres()
    x, y = escape.ensemble(16)
    for row, column in np.argwhere(np.isfinite(times))[::20]:
        alone = escape.escape_time((a[column], b[row]), x, y, 300).min()
        assert times[row, column] == alone
    everywhere, width = preview.on(view, 300)
    assert width > preview.stays
    assert not np.isnan(everywhere).any()
    assert 0.1 < np.isnan(times).mean() < 0.9


def test_the_distance_to_the_boundary_is_measured_along_the_ray():
    known = Rays(two_kicks())
    known.known |= rays._on_ray(two_kicks(), 20.0, 1e-2) | rays._on_ray(two_kicks(), 22.0, 1e-2)
    for angle in (21.0, 159.0, 249.0):
        direction = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
        scale = barriers.critical_scale(direction, 1e-2).value
        excess = known.excess(*(1.07 * scale * direction))
        assert excess == pytest.approx(0.07, abs=2e-4)
        a, b = np.multiply.outer(direction, [[0.0, 0.99 * scale], [1.01 * scale, 2.0]])
        assert (known.excess(a, b) > 0).tolist() == [[False, False], [True, True]]
    assert np.isnan(known.excess(-0.1, 0.5))  # far from all rays
    assert known.nearest(np.cos(0.36), np.sin(0.36)) == known.known[20.0]


@pytest.mark.parametrize(("plane", "angle"), [(two_kicks(), 20.0), (three_kicks(0.2), 100.0)])
def test_a_ray_gives_the_boundary_on_all_its_images(plane, angle):
    found = rays._on_ray(plane, angle, 1e-2)
    table = Rays(plane)
    table.add(barrier.boundary(sorted(found), 1e-2, plane))
    assert sorted(found) == sorted(plane.unfold(angle).tolist())
    assert found.keys() == table.known.keys()
    for image, breakup in found.items():
        stored = table.known[image]
        assert breakup.circle == stored.circle
        assert breakup.omega == pytest.approx(stored.omega, rel=1e-14)
        assert breakup.scale == pytest.approx(stored.scale, abs=stored.error)


@pytest.mark.parametrize("plane", [two_kicks(), rotating("1/3"), three_kicks(0.2)])
def test_a_view_needs_a_limited_number_of_rays_and_none_the_second_time(plane):
    known, ray = Rays(plane), Breakup(1.0, 0.0, "[0;(1)]", 0.618)
    for view in (View((-1, 1), (-1, 1), (54, 54)), View((0.97, 0.9701), (0.96, 0.9601), (54, 54))):
        angles = known.missing(view)
        assert 0 < len(angles) < 400
        known.known |= {at % 360: ray for angle in angles for at in plane.unfold(angle).tolist()}
        assert known.missing(view) == []


BOUNDARIES = {  # scale as a function of an angle in degrees
    "a circle": lambda angle: 0.9,
    "a line": lambda angle: 0.8 / np.cos(np.deg2rad(angle - 10.0)),
    "cusps": lambda angle: 1.0 - 0.1 * np.sqrt(abs(angle - 17.3)),
    "a jump": lambda angle: 0.6 if angle < 17.3 else 0.9,
}


NOBLES = "[0;(1)]", "[0;1,2,(1)]"


def compute_all(known, view, scale, circle=lambda angle: "[0;(1)]", n_workers=1):
    """Let `known` choose all rays of a view, with made-up breakups; return the number of rays.

    The rays that are being computed at the same time end in random order.
    """
    started, running, random = [], [], np.random.default_rng(1)
    calls = rays._calls(known, view, started)
    while True:
        while len(running) < n_workers and (call := next(calls, None)):
            running.append(call[-2])
        if not running:
            assert np.diff(sorted(started)).min(initial=inf) > 1e-6
            return len(started)
        angle = running.pop(random.integers(len(running)))
        breakup = Breakup(scale(angle), 0.0, circle(angle), 0.618)
        known.known |= {at % 360: breakup for at in known.plane.unfold(angle).tolist()}


@pytest.mark.parametrize("n_workers", [1, 6])
@pytest.mark.parametrize(
    ("shape", "middle", "half", "most"),
    [
        ("a circle", (0.0, 0.0), 1.1, 15),
        ("a line", (0.0, 0.0), 1.1, 20),
        ("cusps", (0.0, 0.0), 1.1, 35),
        ("a jump", (0.0, 0.0), 1.1, 25),
        ("a circle", (0.636, 0.636), 0.1, 5),
        ("a circle", (0.51, 0.0), 0.5, 20),  # the origin is just outside
        ("cusps", (0.93, 0.28), 0.1, 25),
    ],
)
def test_a_line_through_few_rays_follows_the_boundary(shape, middle, half, most, n_workers):
    """It misses the boundary by 3 pixels at most, except where tips are narrower than 2 pixels."""
    plane, (a, b) = pairs("1/3"), middle
    known = Rays(plane)

    def scale(folded):  # the rays at 0° and 90° are equivalent, those at 45° and 135° are mirrors
        return BOUNDARIES[shape](folded if folded <= 45 else 90 - folded)

    view = View((a - half, a + half), (b - half, b + half), (594, 594))
    # Rays are chosen before all others are known, so that some prove unnecessary.
    most *= 1 if n_workers == 1 else 1.3
    assert compute_all(known, view, scale, n_workers=n_workers) <= most
    assert known.missing(view) == []
    angles = np.arange(0.0, 360, 0.004)
    radius = np.array([scale(angle) for angle in plane.fold(angles)[0]])
    exact = radius * np.exp(1j * np.deg2rad(angles))
    inside = (np.abs(exact.real - middle[0]) < half) & (np.abs(exact.imag - middle[1]) < half)
    line = sorted(known.known)
    points = np.array([known.known[at].scale * np.exp(1j * np.deg2rad(at)) for at in line])
    after = np.searchsorted(line, angles, side="right") % len(line)
    start, chord = points[after - 1], points[after] - points[after - 1]
    part = ((exact - start) / chord).real.clip(0, 1)
    pixel = view.pixel[0]
    width = np.deg2rad(np.diff(line, append=360))[after - 1] * np.abs(start)
    assert inside.sum() > 500
    assert np.abs(exact - start - part * chord)[inside & (width > 2 * pixel)].max() < 3 * pixel


def test_rays_without_a_breakup_do_not_end_the_refinement():
    def scale(angle):
        return nan if angle in (33.75, 37.5) else 0.9 + 0.3 * np.exp(-(((angle - 37.5) / 6) ** 2))

    known = Rays(rotating("1/3"))
    compute_all(known, View((-1.2, 1.2), (-1.2, 1.2), (594, 594)), scale)
    assert {33.75, 37.5} < known.known.keys()
    angles, points, _ = known._points()
    near = (angles >= 30) & (angles <= 45)
    assert np.diff(angles[near]).max() < 4
    assert np.diff(np.abs(points[near])).max() < 0.1


def test_points_that_coincide_do_not_stop_the_choice_of_rays():
    known, view = Rays(two_kicks()), View((-1, 1), (-1, 1), (594, 594))
    assert compute_all(known, view, lambda angle: 0.0 if angle < 45 else 0.9) < 30


def test_scattered_scales_do_not_keep_the_workers_busy(monkeypatch):
    random = np.random.default_rng(1)

    def spread(client, calls, leaves_one, priority):
        assert leaves_one
        assert priority < 0
        for _, _, where, angle, _ in calls:
            breakup = Breakup(0.9 + 1e-4 * random.normal(), 0.0, NOBLES[0], 0.618)
            yield None, {at % 360: breakup for at in where.unfold(angle).tolist()}

    monkeypatch.setattr(rays, "spread", spread)
    view = View((-1e-3, 1e-3), (0.899, 0.901), (594, 594))
    pictures = rays.computed(lambda: None, Rays(rotating("1/3")), view, 0.0)
    *_, (known, words) = filter(None, pictures)
    assert (len(known), words) == (300, "150 rays")


def test_rays_are_added_where_the_last_circle_changes():
    plane, known, change = two_kicks(), Rays(two_kicks()), 20.3
    view = View((0.8, 1.0), (0.25, 0.45), (594, 594))
    straight = BOUNDARIES["a circle"]
    few = compute_all(Rays(plane), view, straight)
    more = compute_all(known, view, straight, lambda angle: NOBLES[angle > change])
    assert few < more < 2 * few
    angles = np.array(sorted(known.known))
    after = np.searchsorted(angles, change)
    assert np.deg2rad(angles[after] - angles[after - 1]) * 0.9 < 32 * view.pixel[0]


@pytest.mark.parametrize(
    ("start", "expected"),
    [
        ((0.5, 0.3), "a circle"),
        ((0.5, 0.0), "periodic with ω = 0: residue 0.4, elliptic"),
        ((0.5, 1e-3), "in an island around a periodic orbit with ω = 0"),
        ((1e-3, 1e-3), "chaotic (averages"),
    ],
)
def test_the_description_of_an_orbit_states_its_kind(start, expected):
    assert expected in describe_orbit(np.array([0.5, 0.4]), *start)


@pytest.mark.parametrize("text", ["0.618", "0.5", "1.25", "-0.38", "0.3819660113"])
def test_a_decimal_number_is_replaced_by_a_noble_number_that_rounds_to_it(text):
    noble, words = rays.named_by(text)
    assert parse(noble).tail == (1,)
    assert noble in words
    assert round(float(parse(noble)), len(text.partition(".")[2])) == float(text)


def test_an_ensemble_started_in_a_box_diffuses_like_one_in_the_whole_cell(monkeypatch):
    monkeypatch.setattr(on_demand, "_FRAME_SECONDS", 0)
    monkeypatch.setattr(on_demand, "_SIDE_STARTS", 24)
    kappa, result = np.array([4.0, 3.5]), None
    for result in filter(None, on_demand.spreading(kappa, (0.0, 0.0, 0.5, 0.5))):
        assert result[0]["x"].size == 24**2
    rate, error = map(float, re.search(r"D = (\S+) ± (\S+) per period", result[2]).groups())
    whole = diffusion.diffusion(kappa, n_max=2**15)
    assert rate == pytest.approx(whole.value, abs=4 * np.hypot(error, whole.error))
    assert error < 0.1 * rate


class Document:
    """A stand-in for Bokeh's Document; the tests run its callbacks themselves."""

    def __init__(self):
        self.callbacks = []

    def add_next_tick_callback(self, callback):
        self.callbacks.append(callback)

    def run(self, until):
        end = time.monotonic() + 10
        while not until():
            assert time.monotonic() < end
            while self.callbacks:
                self.callbacks.pop(0)()
            time.sleep(1e-3)


def test_only_the_latest_computation_counts():
    document, result, gate = Document(), [], threading.Event()
    work = Work(document, None)
    work.start()
    lane = work.latest("number")

    def computed(number):
        gate.wait(10)
        return number

    for number in range(5):
        lane.submit(computed, number, done=result.append)
    assert list(work.busy) == ["number"]
    gate.set()
    document.run(lambda: not work.busy)
    assert result == [4]
    lane.submit(lambda: 1 // 0, done=result.append)
    document.run(lambda: not work.busy)
    assert result == [4]
    assert work.failed == {"number": "ZeroDivisionError('integer division or modulo by zero')"}


@pytest.mark.parametrize(
    ("options", "expected"),
    [([], CPU_COUNT + 1), (["--workers", "3"], 3), (["--scheduler", "tcp://127.0.0.1:1"], None)],
)
def test_one_worker_more_than_cores_is_started_by_default(options, expected, tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(server, "serve", lambda *args: asked.append(args[-1]["n_workers"]))
    invoke("explore", tmp_path, *options)
    assert asked == [expected]


@pytest.mark.parametrize(("n_workers", "expected"), [(1, 1), (2, 1), (5, 4)])
def test_calls_that_cannot_be_interrupted_leave_one_worker_free(n_workers, expected):
    running = []

    def submit(function, *args, pure, priority):
        running.append(Future())
        running[-1].release = lambda: None
        return running[-1]

    client = SimpleNamespace(
        status="running",
        nthreads=lambda: dict.fromkeys(range(n_workers), 1),
        submit=submit,
        cancel=lambda futures: None,
    )
    results = spread(client, ((number, abs, number) for number in range(50)), leaves_one=True)
    assert next(results) is None
    assert len(running) == expected
    running[0].set_result("a result")
    assert next(results) == (0, "a result")
    assert next(results) is None
    assert len(running) == expected + 1
    results.close()


def test_a_closed_tab_ends_its_generators():
    document, result, closed = Document(), [], threading.Event()
    work = Work(document, None)

    def endless():
        try:
            while True:
                yield 1
                time.sleep(1e-3)
        finally:
            closed.set()

    work.latest("endless").submit(endless, done=result.append)
    assert not work.busy  # the browser is not connected yet
    work.start()
    document.run(lambda: result)
    work.close()
    assert closed.wait(10)


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("k1=x", "'x' is not a number"),
        ("k1=inf", "not finite"),
        ("k2=1e9", "too large"),
        ("n=7", "n='7' must be a whole number from 100"),
        ("k1=0.1&plane=rotating:1/3", "start another with --plane rotating:1/3"),
        ("a=0.1", "'0.1' must be a range, like"),
        ("a=0.3:0.1", "the range 0.3:0.1 must be 2.3e-09 to 69 wide"),
        ("b=nan:1", "the range nan:1.0 must be"),
        ("y=-1:1", "the range -1.0:1.0 must be 1e-09 to 1 wide"),
        ("omega=3/5", "3/5 is rational, and has no circle"),
        ("pq=3/1001", "'3/1001' must be a fraction like 3/8"),
        ("orbits=0.5", "'0.5' must be two numbers, like"),
        ("orbits=0,inf", "'0,inf' must be two numbers, like"),
        ("orbits=" + "0.5,0.3;" * 51, "orbits: 51 is too many; at most 50 are allowed"),
        (
            "show=boundary,all",
            "must be a list of names from boundary,kicks,symmetry,cycles,manifolds",
        ),
    ],
)
def test_invalid_state_in_an_address_is_explained_and_changes_nothing(query, words):
    state = State(two_kicks())
    first = state.address()
    with pytest.raises(ValueError, match=re.escape(words)):
        state.go({"k1": "0.25"} | dict(parse_qsl(query)))
    assert state.address() == first


def test_the_boundary_on_a_ray_is_known_if_rays_begin_at_zero_forcing():
    result = verdict((0.3, 0.2, 0.2))
    for forcings, known in ((rotating("1/3"), True), (three_kicks(0.2), False)):
        state = State(forcings)
        state.move(0.3, 0.2)
        assert state.boundary is None
        state.take(verdict=result)
        assert (state.boundary is not None) == known
    state = State(two_kicks())
    state.move(0.3, 0.2)
    state.take(verdict=verdict(state.kappa))
    state.move(*state.boundary)
    near = barriers.critical_scale(state.kappa, 1e-3)
    assert near.value == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize(
    ("answer", "value", "words"),
    [
        (Answer.BARRIER, 1.25, "inside the boundary, which is at 1.25"),
        (Answer.TRANSPORT, 0.75, "beyond the boundary, which is at 0.75"),
        (None, 1.25, "inside the boundary, which is at 1.25"),
        (None, 0.75, "beyond the boundary, which is at 0.75"),
        (None, np.inf, ""),
        (Answer.BARRIER, 1 - 1e-9, "on the boundary, or very close to it"),
        (Answer.TRANSPORT, 1 + 1e-9, "on the boundary, or very close to it"),
        (
            Answer.UNDECIDED,
            1 - 1e-9,
            "undecided: too close to the boundary, which is at 1",
        ),
        (
            Answer.UNDECIDED,
            1 + 1e-9,
            "undecided: too close to the boundary, which is at 1",
        ),
        (Answer.UNDECIDED, np.nan, ""),
    ],
)
def test_the_side_of_the_boundary_agrees_with_the_verdict(answer, value, words):
    output = plane.side_text(answer, value, f"{value:.6g}")
    assert output.startswith(words)
    assert bool(output) == bool(words)


def test_a_verdict_is_dropped_when_the_point_moves():
    state, seen = State(two_kicks()), []
    state.take(verdict=verdict(state.kappa))
    state.on("point", lambda: seen.append(state.verdict))
    state.move(*state.point)
    assert state.verdict is not None
    state.move(0.3, 0.2)
    assert seen == [None]


@pytest.mark.parametrize("direction", range(0, 360, 30))
def test_the_marker_of_a_point_outside_the_view_points_towards_it(direction):
    towards = np.exp(1j * np.deg2rad(direction))
    mark = plane._mark_of((5 * towards.real, 10 * towards.imag), [(-1.0, 1.0), (-2.0, 2.0)])
    assert mark["marker"] == ["triangle"]
    x, y = mark["x"][0], mark["y"][0] / 2
    assert 0.9 < max(abs(x), abs(y)) < 1
    tip = 1j * np.exp(1j * mark["angle"][0])
    there = complex(5 * towards.real - x, 5 * towards.imag - y)
    assert tip == pytest.approx(there / abs(there))
    assert (tip * np.conj(complex(x, y))).real > 0  # pointing out of the view


def test_a_link_contains_everything_that_a_tab_shows():
    state = State(rotating("1/3"))
    state.move(0.1, -0.2)
    state.follow("[0;2,(1)]")
    state.seek("6/16")
    state.take(steps=200, a=(0.1, 1 / 3), b=(-0.3, -0.1), x=(0.25, 0.5), y=(1 / 7, 0.2))
    state.take(orbits=((0.5, 0.3), (1 / 3, -0.1)), show=frozenset({"kicks", "cycles"}))
    again = State(state.plane)
    again.go(dict(parse_qsl(state.address())))
    parts = {name for name in vars(state) if not name.startswith("_")}
    parts -= {"verdict", "datasets", "drawn", "plays"}
    assert parts > {"point", "a", "y", "orbits", "show"}
    for name in parts:
        assert getattr(again, name) == getattr(state, name)
        assert name == "plane" or getattr(again, name) != getattr(State(state.plane), name)


def test_zooming_does_not_change_the_colour_of_a_circle():
    rays, names = Rays(two_kicks()), ["[0;(1)]", *(f"[0;{i},(1)]" for i in range(2, 9))]
    for angle in range(360):
        circle = names[0 if angle % 9 == 4 else 1 + angle // 7 % 7]
        rays.known[float(angle)] = Breakup(1.0, 0.0, circle, 0.618)
    a, b = np.cos(np.deg2rad(40)), np.sin(np.deg2rad(40))  # on the ray of a golden circle
    for half in (1.2, 0.4, 0.13, 0.04):
        lines, legend = rays.lines(View((a - half, a + half), (b - half, b + half), (27, 27)))
        golden = circle_style(names[0])["color"]
        assert lines["colour"][40] == legend.get(names[0], golden) == golden
    assert names[0] in legend


def with_page(ask, client=None):
    """Run `ask(port)`, a coroutine, against a server without workers; return its result.

    client : as for `Shared`.
    """

    async def asked():
        sockets, port = bind_sockets("127.0.0.1", 0)
        page = server.server_of(server.Shared(two_kicks(), None, client), sockets, port)
        result = await ask(port)
        page.stop()
        return result

    with ThreadPoolExecutor() as thread:  # Playwright may run an event loop in this thread
        return thread.submit(asyncio.run, asked()).result()


def answers(requests):
    """Return the answers of a server without workers, and the list of what it computed.

    requests : the (path, headers) of each request.
    """

    async def ask(port):
        client, result = AsyncHTTPClient(), []
        for path, headers in requests:
            named = {name: text.format(port=port) for name, text in headers.items()}
            url = f"http://127.0.0.1:{port}{path}"
            result.append(await client.fetch(url, headers=named, raise_error=False))
        return result

    computed = []
    return with_page(ask, lambda: computed.append("something")), computed


WEBSOCKET = {"Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13"}
WEBSOCKET |= {"Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Protocol": "bokeh"}

ELSEWHERE, FOREIGN = "elsewhere.example", ("cross-site", "same-site")
SCRIPT, OTHER = "/static/js/bokeh.min.js", f"{ELSEWHERE}:{{port}}"
OURS = "localhost:{port}", "127.0.0.1:{port}", "[::1]:{port}", "LOCALHOST:{port}"
REQUESTS = [  # path, headers, and the expected HTTP status
    *((SCRIPT, {"Host": name}, 200) for name in OURS),
    *((SCRIPT, {"Host": name}, 403) for name in (ELSEWHERE, OTHER, "localhost.x", "10.1.2.3")),
    *((path, {"Host": OTHER}, 403) for path in ["/", "/ws", "/metadata", "/autoload.js", "/none"]),
    ("/none", {}, 404),
    ("/ws", WEBSOCKET | {"Host": OTHER, "Origin": f"http://{OTHER}"}, 403),
    *(("/ws", WEBSOCKET | {"Origin": origin}, 403) for origin in (f"http://{ELSEWHERE}", "null")),
    ("/ws", WEBSOCKET | {"Origin": "http://["}, 403),
    ("/ws", WEBSOCKET | {"Origin": "http://localhost:1"}, 403),  # a page from another local server
    ("/?k1=%ff", {}, 200),  # the answer is a page with a message
    ("/?plane=%c3%28&n=%00", {}, 200),
    ("/?omega=0.5000000000000000000000000000000", {}, 200),
]


def fetch(site, what):
    """Return the headers in which a browser states the origin and the purpose of a request."""
    return {"Sec-Fetch-Site": site, "Sec-Fetch-Dest": what}


AUTOLOAD = "/autoload.js?bokeh-autoload-element=a"
REQUESTS += [
    *(("/", fetch(site, what), 403) for site in FOREIGN for what in ("image", "iframe", "empty")),
    *((path, fetch(site, "script"), 403) for site in FOREIGN for path in (SCRIPT, AUTOLOAD)),
    *((SCRIPT, fetch(site, "script"), 200) for site in ("same-origin", "none")),
    *(("/?k1=0.3", fetch(site, "document"), 200) for site in ("none", "same-origin", *FOREIGN)),
    ("/", fetch("cross-site", "document") | {"Origin": f"http://{ELSEWHERE}"}, 403),
]


def test_local_host_names_are_accepted_and_other_sites_are_refused():
    result, _ = answers([request[:2] for request in REQUESTS])
    assert [answer.code for answer in result] == [code for *_, code in REQUESTS]


def test_a_refusal_of_another_host_name_explains_how_to_reach_the_page():
    (refused,), _ = answers([("/?k1=0.3", {"Host": "hub.example.org:8000"})])
    words = refused.body.decode()
    assert "for hub.example.org:8000" in words
    assert re.search(r"ssh -L (\d+):localhost:\1 MACHINE", words)
    assert refused.headers["Content-Type"].startswith("text/plain")  # the name may contain anything


@pytest.mark.parametrize("name", ["localhost:{}", "127.0.0.1:{}", "[::1]:{}"])
@pytest.mark.parametrize("forwarded", [True, False])
@pytest.mark.parametrize("site", [None, "hub.example.org"])
def test_a_page_on_any_port_forwarded_by_ssh_can_connect(name, forwarded, site, monkeypatch):
    if site:
        monkeypatch.setenv("BOKEH_ALLOW_WS_ORIGIN", site)  # set for other Bokeh servers

    async def status(port):
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        host = name.format(9956 if forwarded else port)
        headers = WEBSOCKET | {"Host": host, "Origin": f"http://{host}"}
        lines = ["GET /ws HTTP/1.1", *map(": ".join, headers.items()), "", ""]
        writer.write("\r\n".join(lines).encode())
        line = await asyncio.wait_for(reader.readline(), 10)
        writer.close()
        return line

    assert b" 101 " in with_page(status)


@pytest.mark.parametrize(
    ("path", "headers"),
    [("/", {}), (SCRIPT, {}), (AUTOLOAD, {}), ("/none", {}), ("/", {"Host": ELSEWHERE})],
)
def test_every_response_has_headers_that_protect_it_from_other_sites(path, headers):
    (answer,), _ = answers([(path, headers)])
    assert "frame-ancestors 'none'" in answer.headers["Content-Security-Policy"]
    assert "default-src 'self';" in answer.headers["Content-Security-Policy"]
    assert answer.headers["X-Frame-Options"] == "DENY"
    assert answer.headers["X-Content-Type-Options"] == "nosniff"
    assert answer.headers["Referrer-Policy"] == "same-origin"
    assert answer.headers["Cross-Origin-Resource-Policy"] == "same-origin"


_POST = "POST / HTTP/1.1\r\nHost: localhost\r\n"


async def said_to(port, text):
    """Send a text as a slow client would; return the first line of the answer.

    The line is b"" if the server closes the connection without an answer.
    """
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(text.encode())
    line = await reader.readline()
    writer.close()
    return line


def test_slow_clients_are_disconnected_and_do_not_delay_others(monkeypatch):
    monkeypatch.setattr(server, "_SLOWEST", 2)
    slow = ["", "GET / HTTP/1.1\r\nHost: localhost\r\nX: ", f"{_POST}Content-Length: 99\r\n\r\na"]
    slow += [f"{_POST}Transfer-Encoding: chunked\r\n\r\n63\r\na"]

    async def ask(port):
        waiting = [asyncio.create_task(said_to(port, text)) for text in 50 * slow]
        await asyncio.sleep(0.1)
        page = await AsyncHTTPClient().fetch(f"http://127.0.0.1:{port}{SCRIPT}")
        return page.code, await asyncio.wait_for(asyncio.gather(*waiting), 60)

    code, lines = with_page(ask)
    assert code == 200
    assert {*lines} == {b""}


@pytest.mark.parametrize(
    "body", [f"Content-Length: {10**6}\r\n\r\n", "Transfer-Encoding: chunked\r\n\r\nfffff\r\n"]
)
def test_large_request_bodies_are_refused(body):
    async def ask(port):
        return await asyncio.wait_for(said_to(port, _POST + body), 60)

    assert b" 400 " in with_page(ask)


def test_a_browser_in_the_foreground_does_not_block_the_server(tmp_path):
    program = tmp_path / "browser"
    program.write_text('#!/bin/sh\ntouch "$0.opened"\nexec sleep 100\n')
    program.chmod(0o755)
    command = [sys.executable, "-m", "workflows.explore", "--port", "0", "--workers", "1"]
    asked = os.environ | {"BROWSER": str(program)}
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=asked) as process:
        try:
            output = "".join(iter(process.stderr.readline, "Ctrl-C ends it\n"))
            toy.wait_until((tmp_path / "browser.opened").exists)
            url = re.search(r"http://localhost:\d+/", output).group()
            with urllib.request.urlopen(url, timeout=60) as page:
                assert b"Global transport" in page.read()
        finally:
            for one in psutil.Process(process.pid).children(recursive=True):
                one.kill()
            process.kill()


@pytest.mark.parametrize(
    ("program", "opens"), [("w3m", 0), ("/usr/bin/lynx", 0), ("www-browser", 0), ("chromium", 1)]
)
def test_a_text_mode_browser_is_not_opened(monkeypatch, program, opens):
    opened = []
    browser = SimpleNamespace(name=program, open=opened.append)
    monkeypatch.setattr(webbrowser, "get", lambda: browser)
    server._open("http://localhost:1/")
    assert len(opened) == opens


def test_work_that_needs_no_kernels_does_not_wait_for_their_compilation():
    document, result, loaded = Document(), [], threading.Event()
    work = Work(document, None, {"verdict": loaded})
    work.start()
    for kernels in ("verdict", None):
        work.latest(str(kernels), kernels).submit(
            lambda kernels=kernels: kernels or "none", done=result.append
        )
    document.run(lambda: result)
    assert result == ["none"]
    loaded.set()
    document.run(lambda: not work.busy)
    assert result == ["none", "verdict"]


_EVERYTHING = "k1=0.3&k2=0.2&n=100&omega=gamma&pq=3/8&orbits=0.5,0.3&show=boundary,cycles,manifolds"


@pytest.mark.parametrize(
    ("path", "headers", "code"),
    [
        ("/", {}, 200),
        (f"/?{_EVERYTHING}", {}, 200),
        (f"{AUTOLOAD}&{_EVERYTHING}", {}, 200),
        (f"/?{_EVERYTHING}", {"Cookie": "k1=0.3; =; bokeh-session-id=x"}, 200),
        (f"/?{_EVERYTHING}", {"Cookie": "k1=\x01"}, 400),
        (f"/?{_EVERYTHING}&bokeh-session-id=..%2f..", {}, 200),
        (f"/?{_EVERYTHING}&bokeh-token=e30.x", {}, 500),
        (f"/none/..%2f?{_EVERYTHING}", {}, 404),
        (f"/?pq=1e-99999999&omega=1{60_000 * '+'}1", {}, 200),
    ],
)
def test_a_page_that_is_requested_but_not_shown_computes_nothing(path, headers, code, monkeypatch):
    threads = []
    monkeypatch.setattr("workflows.explore.work.Thread", lambda **how: threads.append(how))
    (answer,), computed = answers([(path, headers)])
    assert answer.code == code
    time.sleep(0.2)  # a verdict would be computed only after a short delay
    assert (computed, threads) == ([], [])


_BLOCKED = """
import hashlib, sys
from workflows.explore import server
server._GRACE = 1
server.Shared.prepare = lambda shared: None
def fill(document, shared):
    print("blocked", flush=True)
    {}
server.fill = fill
from workflows.explore.__main__ import main
main(["--port", "0", "--no-browser", "--out", sys.argv[1]])
"""


@pytest.mark.parametrize(
    ("number", "blocks"),
    [
        # The second statement never releases the GIL; the third releases it, as a kernel does.
        (signal.SIGINT, "while True: pass"),
        (signal.SIGTERM, "10 ** 10 ** 9"),
        (signal.SIGINT, "hashlib.pbkdf2_hmac('sha256', b'', b'', 2**31 - 1)"),
    ],
)
def test_a_signal_ends_the_explorer_whatever_blocks_its_event_loop(number, blocks, tmp_path):
    command = [sys.executable, "-c", _BLOCKED.format(blocks), str(tmp_path)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as process:
        try:
            output = "".join(iter(process.stderr.readline, "Ctrl-C ends it\n"))
            port = int(re.search(r"localhost:(\d+)/", output).group(1))
            with socket.create_connection(("127.0.0.1", port)) as browser:
                browser.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
                assert process.stdout.readline() == "blocked\n"
                process.send_signal(number)
                assert process.wait(60) == -signal.SIGALRM
        finally:
            process.kill()


def test_workers_count_as_started_while_kernels_are_being_compiled(monkeypatch):
    compiling, ended = threading.Event(), threading.Event()

    def load():
        compiling.set()
        ended.wait(60)

    done = SimpleNamespace(result=lambda: None)
    client = SimpleNamespace(status="running", submit=lambda call, pure: done)
    monkeypatch.setattr(server, "_KERNELS", {"portrait": load})
    shared = server.Shared(two_kicks(), None, lambda: client)
    thread = threading.Thread(target=shared.prepare)
    thread.start()
    assert compiling.wait(60)
    assert shared.connected.is_set()  # Ctrl-C waits only for this event
    assert not shared.loaded["portrait"].is_set()
    ended.set()
    thread.join()
    assert shared.loaded["portrait"].is_set()


@pytest.mark.parametrize("must_compile", [True, False])
def test_kernels_that_must_be_compiled_are_compiled_in_a_worker(must_compile, monkeypatch):
    events = []
    on_worker = SimpleNamespace(result=lambda: events.append("worker"))
    client = SimpleNamespace(status="running", submit=lambda call, pure: on_worker)
    monkeypatch.setattr(server, "are_missing", lambda: must_compile)
    monkeypatch.setattr(server, "_KERNELS", {"portrait": lambda: events.append("server")})
    shared = server.Shared(two_kicks(), None, lambda: client)
    shared.opened.set()
    shared.prepare()
    assert shared.preparing == ""
    assert events[0] == ("worker" if must_compile else "server")
    assert {*events} == {"worker", "server"}


LOADING = """
from first_calls import loaded
from workflows.explore import on_workers
from workflows.shared.phase_space import portrait

on_workers.load_portrait_kernels()
before = loaded()
assert before
portrait((0.3, 0.2))
print(loaded() - before)
"""


def test_a_portrait_needs_only_kernels_that_are_loaded_in_advance():
    done = subprocess.run(
        [sys.executable, "-c", LOADING], capture_output=True, text=True, cwd=Path(__file__).parent
    )
    assert (done.stdout, done.stderr) == ("set()\n", "")


def test_orbits_that_are_not_found_are_named_and_short_ones_are_drawn(monkeypatch):
    fraction = Fraction(1, 6)
    result, missing = phase_space.periodic_orbits((1.0,), [fraction])
    assert [family for _, family, *_ in result] == ["minimizing", "minimax"]
    assert missing == []
    curves, words = on_demand.resonance((1.0,), fraction, (0.0, -0.5, 1.0, 1.0))
    assert words.startswith("Turnstiles of 1/6: ")
    assert len(curves["lobes"]["x"]) == 4

    def losing(self, n, scale):
        raise self.chains[n].lost("a test")

    monkeypatch.setattr(action.ConvergentOrbits, "scan", losing)
    result, missing = phase_space.periodic_orbits((1.0,), [fraction])
    assert (result, missing) == (
        [], ["Not drawn: the ordered orbits of 1/6 were not found: a test."]
    )  # fmt: skip


def test_missing_lobes_of_a_resonance_are_explained():
    _, words = on_demand.resonance((0.0, 0.0), Fraction(1, 2), (0.0, -0.5, 1.0, 1.0))
    assert "No turnstile at the upper edge: the minimizing orbit of 1/2 is not hyperbolic" in words
