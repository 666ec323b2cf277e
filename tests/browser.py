"""The explorer in headless Chromium: a server, started as a user would start it, and its pages."""

import json
import re
import shutil
import signal
import subprocess
import sys
from contextlib import ExitStack, contextmanager, suppress

import psutil
import pytest
import toy
from commands import succeed

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
needed = pytest.mark.skipif(
    CHROMIUM is None, reason="Chromium is not installed: apt-get install chromium"
)
PATIENCE = 100_000  # milliseconds; kernels may have to be compiled first


@pytest.fixture(scope="session")
def served(store):
    """Yield the address and process of an explorer of `store`; afterwards, stop it with Ctrl-C."""
    command = [sys.executable, "-m", "workflows.explore", "--port", "0", "--no-browser"]
    command += ["--out", str(store), "--workers", "1"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            output = "".join(iter(process.stderr.readline, "Ctrl-C ends it\n"))
            yield re.search(r"http://localhost:\d+/", output).group(), process
            family = psutil.Process(process.pid).children(recursive=True)
            process.send_signal(signal.SIGINT)
            _, printed = process.communicate(timeout=60)
            ended = process.returncode, printed, psutil.wait_procs(family, 60)[1]
            if ended != (0, "", []):
                raise AssertionError(f"exit code, output and processes left after Ctrl-C: {ended}")
        finally:
            process.kill()


@pytest.fixture(scope="session")
def store(tmp_path_factory, here, workers):
    """Return a directory with escape times on a small plane, and a stand-in for the boundary."""
    from nasm.planes import two_kicks
    from pipeline.cubes.barrier import last_barrier
    from workflows.explore.field import View
    from workflows.explore.rays import Rays
    from workflows.explore.state import State

    out = tmp_path_factory.mktemp("explored")
    small = "--first -2:2:64 --second -2:2:64 --n-max 300 --n-orbits 16 --levels 3 --tile 8"
    succeed("escape_plane", out, *small.split(), *workers)
    first = State(two_kicks())
    angles = Rays(first.plane).missing(View(first.a, first.b, (27, 27)))
    job = last_barrier(first.plane, angles, 0.1)

    def alike(coords, settings):  # repeats the first ray, as computing all rays takes seconds
        one = job.compute({"angle": coords["angle"][:1]}, settings)
        return {name: values.repeat(coords["angle"].size, -1) for name, values in one.items()}

    toy.run(here, out, job.cube, compute=alike)
    return out


@pytest.fixture(scope="session")
def chromium():
    """Yield headless Chromium, shared by all tests of the session."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@contextmanager
def pages(chromium, url):
    """Yield a function that opens the explorer in a tab, with a query and a width.

    At the end, close the tabs and check that no script has failed.
    """
    failures = []

    def opened(query="", width=1400):
        view = {"width": width, "height": 900}
        context = contexts.enter_context(chromium.new_context(viewport=view, base_url=url))
        tab = context.new_page()
        tab.set_default_timeout(PATIENCE)
        tab.on("pageerror", lambda error: failures.append(error))
        tab.on("console", lambda message: message.type == "error" and failures.append(message.text))
        tab.goto(url + query)
        wait(tab, "window.Bokeh?.documents[0]?.is_idle")
        return tab

    with ExitStack() as contexts:
        yield opened
    assert [str(failure) for failure in failures] == []


def wait(tab, condition, argument=None, timeout=PATIENCE):
    """Wait until a condition in JavaScript is true.

    By default Playwright checks before each frame, which makes the browser redraw continuously.
    """
    return tab.wait_for_function(condition, arg=argument, timeout=timeout, polling=50)


def ready(tab, but="nothing"):
    """Wait until nothing is being computed except the tasks named in `but`, e.g. "this|that"."""
    wait(tab, """(but) => {
        const line = Bokeh.documents[0].get_model_by_name("status").text
        const words = line.match(/>(.*?)( …)?</)[1].replace(/ \\(.*?\\)/g, "")
        return words == "ready" || words.startsWith("computing: ")
            && words.slice(11).split(", ").every((word) => but.split("|").includes(word))
    }""", but)  # fmt: skip


def insist(gesture, happened):
    """Repeat a gesture until happened(timeout=…), which waits for the effect, does not time out.

    On a busy machine the mouse may pause for 0.3 s, which Bokeh interprets as a long press.
    """
    from playwright.sync_api import TimeoutError

    for _ in range(19):
        gesture()
        with suppress(TimeoutError):
            return happened(timeout=PATIENCE / 20)
    gesture()
    return happened(timeout=PATIENCE / 20)


def click(tab, label, at, happened):
    """Click in a picture, at fractions of its width and height, until `happened` returns."""
    spot = spots(tab, label, at)[0]
    return insist(lambda: tab.mouse.click(*spot), happened)


def drag(tab, label, start, end, happened):
    """Drag the mouse in a picture from one place to another."""
    start, end = spots(tab, label, start, end)

    def gesture():
        tab.mouse.move(*start)
        tab.mouse.down()
        tab.mouse.move(*end, steps=4)
        tab.mouse.up()

    insist(gesture, happened)


def zoom(tab, label, at, *turns):
    """Turn the mouse wheel at a place in a picture; -600 zooms in by a factor of ten."""
    tab.mouse.move(*spots(tab, label, at)[0])
    for turn in turns:
        tab.mouse.wheel(0, turn)


def spots(tab, label, *parts):
    """Scroll to a picture; return the points at these fractions of its width and height."""
    left, top, width, height = picture(tab, label)
    return [(left + across * width, top + down * height) for across, down in parts]


def columns(tab, name):
    """Return the columns of a data source on the page, as lists; nested arrays are flattened."""
    # Columns are passed as text: Playwright's own conversion of lists of numbers is slower.
    return json.loads(tab.evaluate("""(name) => {
        const data = Bokeh.documents[0].get_model_by_name(name)?.data ?? {}
        const text = (x) => typeof x == "string" ? JSON.stringify(x)
            : x?.length === undefined ? `${x}` : `[${Array.from(x, text)}]`
        return `{${(data instanceof Map ? [...data] : Object.entries(data)).map(
            ([key, column]) => `"${key}": ${text(column)}`)}}`
    }""", name))  # fmt: skip


def picture(tab, label):
    """Scroll to the first figure of a section; return x, y, width and height of its plot area."""
    return tab.evaluate("""(label) => {
        const section = document.querySelector(`section[aria-label="${label}"]`)
        const find = (view) => view.model.type == "Figure" ? view
            : [...(view.child_views ?? [])].map(find).find((found) => found)
        const views = [...Bokeh.index.roots].map(find).filter((view) => view)
        const view = views.find((view) => section.contains(view.root.el.parentElement
            ?? view.root.el) || section.contains(view.root.el))
        view.canvas_view.el.scrollIntoView({block: "nearest", behavior: "instant"})
        const box = view.canvas_view.el.getBoundingClientRect(), frame = view.frame.bbox
        return [box.x + frame.x0, box.y + frame.y0, frame.width, frame.height]
    }""", label)  # fmt: skip
