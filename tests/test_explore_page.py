"""Test the explorer's page in a real browser against values computed directly."""

import re
import subprocess
import sys
from functools import partial
from itertools import takewhile
from urllib.parse import parse_qs, urlparse

import browser
import numpy as np
import psutil
import pytest
import toy
import xarray as xr
from browser import columns, needed, pages, picture, ready, wait
from test_explore import escapes

from nasm import barriers, maps, orbits, periodic, survivors
from nasm.numbers import convergents, parse
from nasm.verdicts import verdict
from workflows.explore.field import View

pytestmark = needed
KAPPA, PLANE, PORTRAIT = (0.5, 0.4), "Plane of forcings", "Phase portrait"
BOX = (0.0, -0.25, 1.0, 1.0)
SLOW = "plane|boundary|circle"  # computations that may go on in the background


def asked(tab):
    """Return the parameters of a page's permalink as {name: text}."""
    return {name: texts[0] for name, texts in parse_qs(urlparse(tab.url).query).items()}


def type_in(tab, label, text):
    """Fill in a field and press Enter."""
    tab.get_by_label(label).fill(text)
    tab.get_by_label(label).press("Enter")


def until(tab, **parts):
    """Wait until the given parameters of the permalink have the given values."""
    for name, value in parts.items():
        wait(tab, f"new URLSearchParams(location.search).get('{name}') == '{value}'")


def message_with(tab, words, timeout=None):
    """Wait for a status line that contains these words, and return its text."""
    line = tab.get_by_role("status").filter(has_text=words)
    line.wait_for(timeout=timeout)
    return line.inner_text()


def at(tab, k1=KAPPA[0], k2=KAPPA[1]):
    """Go to a forcing by typing its strengths."""
    for name, label, value in (("k1", "κ₁", k1), ("k2", "κ₂", k2)):
        if asked(tab)[name] != str(value):
            type_in(tab, label, str(value))
            until(tab, **{name: value})


@pytest.fixture(scope="module")
def opened(chromium, served):
    """Yield the page at KAPPA, with its verdict and portrait shown, and the text of the verdict."""
    with pages(chromium, served[0]) as page:
        tab = page("?k1={}&k2={}&n=100".format(*KAPPA), 900)
        words = message_with(tab, "BARRIER at")
        ready(tab, SLOW)
        yield tab, words


def is_smaller(side):
    """Return JavaScript code that is true if both sides of the portrait are shorter than `side`.

    Both are tested, because they change one after the other.
    """
    data = "Bokeh.documents[0].get_model_by_name('orbits').data"
    return f"Math.max({data}.w[0], {data}.h[0]) < {side}"


def width_asked(tab):
    """Return the width of the plane's view in the page's address, NaN until it has one."""
    low, high = map(float, asked(tab).get("a", "nan:nan").split(":"))
    return high - low


def box_of(tab):
    """Return the left, bottom, width and height of the portrait."""
    result = columns(tab, "orbits")
    return tuple(result[name][0] for name in "xywh")


def pixels(tab):
    """Return the pixels of the portrait: 0 where empty, 1 for chaos, 2 to 255 for ω."""
    (flat,) = columns(tab, "orbits")["pixels"]
    _, _, width, height = picture(tab, PORTRAIT)
    return np.reshape(flat, (int(height), int(width)))


def seen_at(image, box, x, y):
    """Return the values of a picture at the points (x, y) that lie inside it."""
    left, bottom, width, height = box
    rows, columns = image.shape
    row = ((y - bottom) % 1 / height * rows).astype(int)
    column = ((x - left) % 1 / width * columns).astype(int)
    inside = (row < rows) & (column < columns)
    return image[row[inside], column[inside]]


def test_orbits_are_coloured_by_rotation_number_and_the_circle_is_drawn(opened):
    tab, words = opened
    image, expected = pixels(tab), verdict(KAPPA)
    for line, y in ((0.5, 12 * 2 + 1), (0.0, 2 * 14), (0.0, 2 * 20)):  # starts of `orbits.portrait`
        x, y = orbits.orbit(KAPPA, line, y / 80, 500)
        omega, _ = orbits.rotation_number(KAPPA, x[0], y[0], 2000)
        place = 1 if np.isnan(omega) else 2 + 253 * abs((omega + 1) % 2 - 1)
        values = seen_at(image, BOX, x, y)
        assert (values > 0).all()
        assert np.mean(abs(values - place) < 2) > 0.9  # other orbits cover the rest
    result = columns(tab, "circle")
    x, y = np.array(result["x"], float), np.array(result["y"], float)
    there = np.isfinite(x)
    lift, height = expected.circle
    order = np.argsort(lift % 1)
    on_circle = np.interp(x[there], lift[order] % 1, height[order] % 1, period=1)
    assert there.sum() > 2000
    assert abs((y[there] - on_circle + 0.5) % 1 - 0.5).max() < 1e-3  # interpolation error
    assert f"ω = {expected.boundary.omega} =" in words
    assert "certified on a finer grid" in words
    assert re.search(r"This took \d\.\d\d s", words)
    assert f"Certified circle, ω = {expected.boundary.omega}" in message_with(
        tab, "of them chaotic"
    )


def test_the_page_fits_its_window_and_axes_have_labels(opened):
    tab, _ = opened
    at(tab)
    for width in (1400, 900, 390):
        tab.set_viewport_size({"width": width, "height": 900})
        wait(tab, f"document.documentElement.scrollWidth <= {width}")
    labels = tab.evaluate("""[...Bokeh.documents[0]._all_models.values()].filter(
        ({type, visible}) => /Axis$/.test(type) && visible).map(({axis_label}) => axis_label)""")
    assert len(labels) >= 6
    assert all(labels)
    tab.set_viewport_size({"width": 900, "height": 900})


def test_a_point_outside_the_view_is_marked_at_the_edge(opened):
    tab, _ = opened
    at(tab, k1=3.0, k2=2.0)
    tab.get_by_text("outside this picture, beyond the triangle at its edge").wait_for()
    mark, high = columns(tab, "point"), 1.15
    assert (mark["a"], mark["b"], mark["marker"]) == ([3.0], [2.0], ["triangle"])
    for name in "xy":
        assert 0.9 * high < mark[name][0] < high
    at(tab)
    tab.get_by_text("outside this picture").wait_for(state="detached")
    mark = columns(tab, "point")
    assert mark["marker"] == ["circle_cross"]
    assert (mark["x"], mark["y"]) == (mark["a"], mark["b"])


def test_copied_python_code_runs_and_the_data_shown_can_be_saved(opened, tmp_path, capsys):
    tab, _ = opened
    message_with(tab, "BARRIER at")
    ready(tab, SLOW)
    tab.context.grant_permissions(["clipboard-read", "clipboard-write"])
    tab.get_by_role("button", name="copy as Python").click()
    tab.get_by_role("button", name="copied").wait_for()
    exec(tab.evaluate("navigator.clipboard.readText()"), {})
    assert "Answer.BARRIER" in capsys.readouterr().out
    saved = {}
    for which, kind in (("phase space", "netCDF"), ("boundary", "CSV")):
        tab.get_by_label("Save the").select_option(which)
        with tab.expect_download() as download:
            tab.get_by_role("button", name=kind).click()
        saved[kind] = tmp_path / download.value.suggested_filename
        download.value.save_as(saved[kind])
    with xr.open_dataset(saved["netCDF"], engine="scipy") as portrait:
        assert portrait.attrs["kappa"].tolist() == list(KAPPA)
        assert portrait.circle_x.size > 200
    head, *rows = saved["CSV"].read_text().splitlines()
    assert head == "angle,scale,error,circle,omega"
    angles = [float(row.partition(",")[0]) for row in rows]
    assert np.diff(angles, append=360).max() <= 15


def test_toggles_show_symmetry_lines_and_the_orbits_of_the_convergents(opened):
    tab, words = opened
    names = "kick by kick", "symmetry lines", "periodic orbits"
    for name in names:
        tab.get_by_label(name).check()
    for drawn in "cycles", "symmetry":
        wait(tab, f"Bokeh.documents[0].get_model_by_name('{drawn}')?.data.x.length")
    ready(tab, SLOW)
    result = columns(tab, "cycles")
    x, y = np.array(result["x"]), np.array(result["y"])
    omega = parse(re.search(r"ω = (\S+) =", words).group(1))
    shown = takewhile(lambda f: f.denominator <= 34, convergents(omega))
    shown = [f for f in shown if f.denominator > 1]
    assert x.size == 2 * sum(f.denominator for f in shown)
    image_x, image_y = maps.step(KAPPA, x, y)
    apart = abs(x[:, None] - image_x + 0.5) % 1 - 0.5, (y[:, None] - image_y + 0.5) % 1 - 0.5
    assert np.hypot(*apart).min(axis=0).max() < 1e-9  # every image is one of the points
    lines = columns(tab, "symmetry")
    assert {0.0, 0.5} <= set(np.round(lines["x"], 12))  # the symmetry lines before the first kick
    type_in(tab, "Orbits of a fraction", "3/8")
    output = message_with(tab, "3/8: minimizing orbit")
    (residue,) = re.findall(r"minimax orbit: residue (\S+), elliptic", output)
    assert float(residue) == pytest.approx(periodic.residue(KAPPA, 3, 8), rel=1e-5)
    assert sum("3/8 (minimax" in words for words in columns(tab, "cycles")["orbit"]) == 8
    type_in(tab, "Orbits of a fraction", "")
    profile = columns(tab, "profile")
    omega, _ = orbits.rotation_number(KAPPA, 0.5, np.array(profile["y"]), 2000)
    np.testing.assert_array_equal(np.array(profile["x"], float), omega)
    assert np.ptp(profile["y"]) > 0.99
    kicked = orbits.orbit(KAPPA, 0.5, 25 / 80, 400, 1)
    assert (seen_at(pixels(tab), BOX, *kicked) > 1).all()
    for name in names:
        tab.get_by_label(name).uncheck()
    ready(tab, SLOW)


_ALONE = """
const wait = window.setTimeout
window.setTimeout = (call, time, ...rest) => wait(call, time / 10, ...rest)
window.WebSocket = class { close() {} }
"""


def test_a_page_that_cannot_connect_says_so(opened, chromium, served):
    words = "A proxy in between must forward WebSockets"
    with chromium.new_context() as context:
        context.add_init_script(_ALONE)
        tab = context.new_page()
        tab.goto(served[0])
        tab.get_by_role("alert").filter(has_text=words).wait_for()
    assert not opened[0].get_by_text(words).is_visible()


# Returns the name that a screen reader announces for the focused element, even in a shadow root.
_FOCUS = """() => {
    let at = document.activeElement
    while (at.shadowRoot?.activeElement) at = at.shadowRoot.activeElement
    return at.getAttribute("aria-label") || at.title || at.labels?.[0]?.innerText || at.innerText
}"""


def test_keys_reach_all_controls_in_order_and_going_back_undoes_a_move(opened):
    tab, focused = opened[0], []
    at(tab)
    message_with(tab, "BARRIER at")  # so that the button "to the boundary" is enabled
    tab.locator("h1").click()  # so that Tab begins at the top
    while not focused or focused[-1] != "Help":
        tab.keyboard.press("Tab")
        focused.append(tab.evaluate(_FOCUS))
        assert len(focused) < 60
    assert all(focused)
    names = "κ₁|κ₂|to the boundary|N, steps|link|plane of forcings|where the last|where the circle|"
    names += "phase portrait|symmetry lines|Orbits added|copy as Python|netCDF|Help"
    places = [
        [name.startswith(begin) for name in focused].index(True) for begin in names.split("|")
    ]
    assert places == sorted(places)
    tab.get_by_role("application", name="plane of forcings").focus()
    for key in ("ArrowRight", "Shift+ArrowUp"):
        tab.keyboard.press(key)
    wait(tab, "location.search.includes('k2=0.4023')")  # 1% of the view's width, or 0.1% with Shift
    assert float(asked(tab)["k1"]) == pytest.approx(0.523)
    assert tab.get_by_label("κ₁").input_value() == "0.523"
    tab.go_back()
    wait(tab, "!location.search.includes('k2=0.4023') && window.Bokeh?.documents[0]?.is_idle")
    assert float(tab.get_by_label("κ₂").input_value()) == KAPPA[1]


def test_pictures_and_fields_follow_the_dark_mode_of_the_system(opened):
    tab, _ = opened
    painted = """(colours) => [...new Set([...Bokeh.documents[0]._all_models.values()].flatMap(
        (model) => model.type == "Figure" ? [model.border_fill_color] :
        /Axis$/.test(model.type) ? [model.major_label_text_color] : []))].sort() == colours"""
    for scheme, dark in (("light", False), ("dark", True), ("light", False)):
        tab.emulate_media(color_scheme=scheme)
        field = tab.get_by_label("κ₁").evaluate("it => getComputedStyle(it).backgroundColor")
        below = tab.evaluate("getComputedStyle(document.body).backgroundColor")
        for colour in (field, below):
            assert (max(map(int, re.findall(r"\d+", colour)[:3])) < 60) == dark, colour
        # The page notices the change only when it draws the next frame, which may take a while.
        wait(tab, painted, "#16181a,#ddd" if dark else "#222,#fff")


def test_a_click_beyond_the_boundary_shows_the_longest_lived_start(opened):
    value = barriers.critical_scale((1.0, 1.0), 1e-3).value
    tab, _ = opened
    at(tab, k1=value, k2=value)
    assert message_with(tab, re.compile("computing the verdict|UNDECIDED"))
    words = message_with(tab, "UNDECIDED at")
    assert "neither a barrier nor transport could be shown" in words
    tab.get_by_text("undecided: too close to the boundary, which is at 1 times").wait_for()
    assert not re.search("(inside|beyond) the boundary", tab.locator("body").inner_text())
    words = browser.click(tab, PLANE, (0.93, 0.3), partial(message_with, tab, "TRANSPORT at"))
    point = re.search(r"\(kappa1, kappa2\) = \(([^,]*), ([^)]*)\)", words).groups()
    kappa = np.array(point, float)
    assert kappa == pytest.approx([0.86 * 1.15, 0.4 * 1.15], abs=0.02)
    ready(tab, SLOW)
    x, y, steps = survivors.longest_lived_start(kappa, 1000)
    result = columns(tab, "longest_lived")
    traced = orbits.orbit(kappa, x, y, int(steps))
    dots = np.size(result["x"])
    np.testing.assert_allclose(result["x"], traced[0][:dots] % 1, rtol=0, atol=1e-12)
    assert min(traced[0].size, 20) <= dots < picture(tab, PORTRAIT)[2] / 5
    drawn = tab.evaluate("""[...Bokeh.documents[0]._all_models.values()]
        .filter(({data_source}) => data_source?.name == "longest_lived")
        .map(({glyph}) => [glyph.type, glyph.fill_color.value])""")
    assert drawn == [["Scatter", "black"]]
    lifetime = f"{2 * steps:.0f} kicks"
    assert f"No barrier: the longest-lived start is eliminated after {lifetime}" in message_with(
        tab, "of them chaotic"
    )
    assert f"longest-lived start after {2 * steps:.0f} kicks" in words
    (scale,) = re.findall(r"last circle breaks at (\S+) ± \S+ times these strengths", words)
    tab.get_by_text(f"beyond the boundary, which is at {scale} times these").wait_for()
    assert not columns(tab, "circle").get("x")
    assert np.mean(pixels(tab) == 1) > 0.2  # chaos
    tab.get_by_role("button", name="to the boundary").click()
    wait(tab, f"!location.search.includes('k1={kappa[0]}&')")
    there = [float(asked(tab)[name]) for name in ("k1", "k2")]
    assert there == pytest.approx(kappa * float(scale), rel=1e-9)
    for label, value in zip(("κ₁", "κ₂"), there, strict=True):
        shown = tab.get_by_label(label)
        assert shown.evaluate("it => it.scrollWidth <= it.clientWidth")
        shown.press("Enter")
        assert float(shown.input_value()) == pytest.approx(value, rel=1e-9)
    message_with(tab, "UNDECIDED at")
    assert [float(asked(tab)[name]) for name in ("k1", "k2")] == there  # all digits are preserved


def test_a_click_adds_an_orbit_and_zooming_in_computes_orbits_in_the_box(opened):
    tab, _ = opened
    at(tab)
    ready(tab, SLOW)
    words = browser.click(
        tab, PORTRAIT, (0.5, 0.45), partial(message_with, tab, "The orbit added at")
    )
    x, y, omega = map(float, re.search(r"added at \((.*), (.*)\): ω = (\S+)", words).groups())
    assert (x, y) == pytest.approx((0.5, 0.3), abs=0.005)
    assert omega == pytest.approx(float(orbits.rotation_number(KAPPA, x, y, 5000)[0]), abs=1e-6)
    ready(tab, SLOW)
    browser.zoom(tab, PORTRAIT, (0.5, 0.45), -480)
    wait(tab, is_smaller(0.3))
    ready(tab, SLOW)
    box, image = box_of(tab), pixels(tab)
    assert box == pytest.approx((0.4, 0.19, 0.2, 0.2), abs=0.01)
    added = seen_at(image, box, *orbits.orbit(KAPPA, x, y, 5000))
    assert added.size > 5000 * box[2] / 4  # the circle spans the whole cell
    assert (added > 1).all()
    assert (image > 0).mean() > 0.25  # even though the box is small
    browser.drag(tab, PORTRAIT, (0.25, 0.25), (0.75, 0.75), partial(wait, tab, is_smaller(0.15)))
    ready(tab, SLOW)
    assert box_of(tab) == pytest.approx((0.45, 0.24, 0.1, 0.1), abs=0.01)
    tab.get_by_label(PORTRAIT).get_by_title("Reset").click()
    type_in(tab, "Orbits added", "")
    wait(tab, "!/[?&](x|y|orbits)=/.test(location.search)")


def test_play_moves_the_forcing_along_the_ray_and_draws_curves(opened):
    tab, _ = opened
    at(tab)
    message_with(tab, re.compile("breaks? at"))
    tab.get_by_role("button", name="play", exact=True).click()
    wait(tab, f"Bokeh.documents[0].get_model_by_name('point').data.a[0] != {KAPPA[0]}")
    tab.get_by_role("button", name="stop").click()  # playing takes at least 9 s
    wait(tab, "Bokeh.documents[0].get_model_by_name('residues')?.data.residue.length == 3")
    tab.get_by_role("button", name="play", exact=True).wait_for()
    wait(tab, "!location.search.includes('k1={}&k2={}')".format(*KAPPA))
    end = np.array(KAPPA) * 1.15 / KAPPA[0]
    result = columns(tab, "residues")
    curves = (result[key] for key in ("orbit", "at", "residue"))
    for name, parts, values in zip(*curves, strict=True):
        p, q = map(int, name.split("/"))
        assert values[30] == pytest.approx(periodic.residue(parts[30] * end, p, q), rel=1e-4)
    type_in(tab, "κ₁", "0.9")
    tab.get_by_label("manifolds").check()
    type_in(tab, "Orbits of a fraction", "1/2")
    assert "through the upper edge" in message_with(tab, "Turnstiles of 1/2")
    wait(tab, "Bokeh.documents[0].get_model_by_name('unstable')?.data.x.length > 100")
    tab.get_by_role("button", name="spread an ensemble").click()
    message_with(tab, "after 8192 periods")
    counts = columns(tab, "variance")["n"]
    assert counts == [2**i for i in range(len(counts))]
    tool, point = tab.get_by_label(PLANE).get_by_title("Box Zoom"), columns(tab, "point")
    tool.click()
    nearer = partial(wait, tab, "/[?&]a=/.test(location.search)")
    browser.drag(tab, PLANE, (0.25, 0.25), (0.5, 0.5), nearer)
    moved = columns(tab, "point")
    assert [moved[name] for name in "ab"] == [point[name] for name in "ab"]  # the drag only zoomed
    tool.click()
    tab.get_by_label("manifolds").uncheck()
    type_in(tab, "Orbits of a fraction", "")


def test_bad_input_is_explained_below_its_field_and_workers_are_replaced(opened, served):
    tab, _ = opened
    good = {"κ₁": "-0.3", "κ₂": "0.125", "where the circle": "0.618", "Orbits added": "0.5 0.3"}
    good["Orbits of a fraction"] = ""
    for label, text, words in (
        ("κ₁", "one", "'one' is not a number"),
        ("κ₂", "1e7", "too large"),
        ("where the circle", "3/5", "3/5 is rational"),
        ("Orbits added", "0.5", "'0.5' must be two numbers"),
        ("Orbits of a fraction", "3/0", "'3/0' must be a fraction"),
    ):
        type_in(tab, label, text)
        message = tab.get_by_role("alert").get_by_text(words)
        message.wait_for()
        field, below = tab.get_by_label(label).bounding_box(), message.bounding_box()
        assert abs(below["x"] - field["x"]) < 10
        assert 0 < below["y"] - field["y"] < 60
    assert tab.get_by_role("alert").count() == 5  # no message has replaced another
    assert tab.get_by_label("κ₁").input_value() == "one"
    assert tab.get_by_label("where the circle").input_value() == "3/5"
    type_in(tab, "κ₁", good["κ₁"])
    until(tab, k1=good["κ₁"])
    assert tab.get_by_label("κ₂").input_value() == "1e7"  # left as typed while κ₁ is corrected
    for label, text in good.items():
        type_in(tab, label, text)
    tab.get_by_text("a noble number that rounds to it: [0;(1)]").wait_for()
    until(tab, omega="[0;(1)]", orbits="0.5,0.3", k1="-0.3", k2="0.125")
    tab.get_by_role("alert").first.wait_for(state="detached")
    family = psutil.Process(served[1].pid).children(recursive=True)
    (worker,) = (one for one in family if "spawn_main" in " ".join(one.cmdline()))
    ready(tab, "boundary")
    worker.kill()
    tab.get_by_role("slider").press("ArrowRight")
    until(tab, n=200)
    ready(tab, "boundary")
    worker.wait(60)  # until the process has ended
    tab.get_by_role("slider").press("ArrowLeft")
    until(tab, n=100)


def test_a_link_in_another_tab_shows_the_same_page(opened, chromium, served):
    tab, _ = opened
    tab.get_by_label(PLANE).get_by_title("Reset").click()
    wait(tab, "!/[?&]a=/.test(location.search)")
    at(tab)
    moved = partial(wait, tab, f"!location.search.includes('k1={KAPPA[0]}&')")
    browser.click(tab, PLANE, (0.75, 0.25), moved)
    message_with(tab, "BARRIER at")
    there = [float(asked(tab)[name]) for name in ("k1", "k2")]
    assert there == pytest.approx([0.575, 0.575], abs=0.01)
    moved = partial(wait, tab, "new URLSearchParams(location.search).get('k1') < 0.1")
    browser.drag(tab, PLANE, (0.75, 0.25), (0.5, 0.3), moved)
    assert float(asked(tab)["k2"]) == pytest.approx(0.46, abs=0.02)
    for label, spot, part in ((PLANE, (0.98, 0.47), "a"), (PORTRAIT, (0.5, 0.5), "x")):
        browser.zoom(tab, label, spot, -300)
        wait(tab, f"new URLSearchParams(location.search).has('{part}')")
    type_in(tab, "Orbits added", "0.5, 0.3; 0.25, 0.1")
    tab.get_by_label("symmetry lines").check()
    wait(tab, "location.search.endsWith('show=boundary,symmetry')")
    type_in(tab, "where the circle", "[0;2,(1)]")
    until(tab, omega="[0;2,(1)]")
    ready(tab, "boundary|circle")
    with pages(chromium, served[0]) as page:
        again = page("?" + urlparse(tab.url).query, 900)  # a second tab, open at the same time
        wait(again, "Bokeh.documents[0].get_model_by_name('times').data.values[0].length > 1")
        ready(again, "boundary|circle")
        assert asked(again) == asked(tab)
        assert asked(tab).keys() == {*"abxy", "k1", "k2", "n", "omega", "orbits", "show"}
        for name in ("times", "orbits", "symmetry", "point"):
            toy.wait_until(lambda name=name: columns(again, name) == columns(tab, name))
        for label in ("κ₁", "κ₂", "where the circle", "Orbits added"):
            texts = [one.get_by_label(label).input_value() for one in (tab, again)]
            assert texts[0] == texts[1] != ""


_NEVER = """
import sys, time
from workflows.explore import server
server.Shared.prepare = lambda shared: None  # workers and kernels never become ready
from workflows.explore.__main__ import main
main(["--port", "0", "--no-browser", "--out", sys.argv[1]])
"""


def test_stored_results_are_drawn_before_workers_or_kernels_are_ready(chromium, store):
    command = [sys.executable, "-c", _NEVER, str(store)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            output = "".join(iter(process.stderr.readline, "Ctrl-C ends it\n"))
            with pages(chromium, re.search(r"http://localhost:\d+/", output).group()) as page:
                tab = page("?n=200")
                for name in ("times", "ground"):
                    values = f"Bokeh.documents[0].get_model_by_name('{name}').data.values[0]"
                    wait(tab, f"{values}.length > 1")
                times = np.array(columns(tab, "times")["values"][0], float)
                assert np.isfinite(times).any()
                assert np.isnan(times).mean() < 0.1  # the stored plane is wider than the view
                wait(tab, "Bokeh.documents[0].get_model_by_name('boundary')?.data.a.length > 9")
                assert len(columns(tab, "orbits")["pixels"][0]) == 1
        finally:
            process.kill()


def test_on_a_phone_panels_are_stacked_and_a_zoom_shows_escape_times(opened):
    tab, _ = opened
    tab.set_viewport_size({"width": 390, "height": 900})
    wait(tab, "document.documentElement.scrollWidth <= 390")
    _, top, width, height = picture(tab, PLANE)
    assert width > 250
    for label in ("κ₁", "κ₂", "N, steps"):  # these fields are above the picture
        field = tab.get_by_label(label).bounding_box()
        assert 0 < top - field["y"] < 250
    portrait = tab.locator(f'section[aria-label="{PORTRAIT}"]').bounding_box()
    assert portrait["y"] > top + height
    verdict, lines = (tab.get_by_label(name).bounding_box() for name in ("Verdict", "Lines in the"))
    assert top + height < verdict["y"] < min(top + height + 150, lines["y"])
    for n in (200, 500):
        tab.get_by_role("slider").press("ArrowRight")
        until(tab, n=n)
    browser.zoom(tab, PLANE, (0.98, 0.47), *[-600] * 5)  # each turn of the wheel zooms in tenfold
    shown = "Bokeh.documents[0].get_model_by_name('times').data"
    wait(tab, f"{shown}.da[0] < 1e-4 && {shown}.values[0].some(Number.isFinite)")
    toy.wait_until(lambda: np.isclose(tab.evaluate(f"{shown}.da[0]"), width_asked(tab), rtol=1e-9))
    ready(tab, "boundary|circle")
    shape = tuple(tab.evaluate(f"{shown}.values[0].shape"))
    times = np.reshape(columns(tab, "times")["values"][0], shape)
    assert np.isfinite(times).mean() > 0.9
    # n* depends on the last bit of a forcing, so `View` must reproduce the forcings exactly.
    view = View(*(tuple(map(float, asked(tab)[side].split(":"))) for side in "ab"), shape)
    where = range(0, min(shape), 5)
    assert [times[i, i] for i in where] == [escapes(view, i, i, n) for i in where]
    tab.set_viewport_size({"width": 900, "height": 900})


def test_the_server_listens_on_localhost_only(served):
    main = psutil.Process(served[1].pid)
    family = [main, *main.children(recursive=True)]
    ports = [port.laddr for one in family for port in one.net_connections() if not port.raddr]
    assert {port.ip for port in ports} == {"127.0.0.1"}
