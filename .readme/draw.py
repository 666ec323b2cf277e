"""Redraw the pictures of the README: python .readme/draw.py out

The directory `out` contains the cubes of critical_boundary, proved_map and work_precision, each in
a folder named after its command; without --out, the commands write them there. If cubes are
missing, their picture is left unchanged, and the command that computes them is printed. The picture
of the explorer is a screenshot, taken with Chromium and Playwright; it shows the data in
critical_boundary.
"""

import re
import shutil
import signal
import subprocess
import sys
from io import BytesIO
from pathlib import Path

import numpy as np
import xarray as xr
from PIL import Image

from pipeline.cubes.barrier import unfolded
from pipeline.cubes.proved import everywhere
from workflows.figures import planes, style
from workflows.figures.proved_map import draw_proved_map
from workflows.figures.work_precision import draw_work_precision

HERE = Path(__file__).parent
PATIENCE = 100_000  # milliseconds


def keep(figure, name, dpi):
    """Write the figure as NAME.png in true colour, because a palette would mix colours."""
    drawn = BytesIO()
    figure.savefig(drawn, dpi=dpi, bbox_inches=style.finish(figure))
    Image.open(drawn).convert("RGB").save(HERE / f"{name}.png", optimize=True)


def boundary(cube):
    """Draw CB_gt alone, coloured and labelled by its last circles."""
    barrier = cube("boundary")
    figure = style.canvas(8, 5, 0)
    axes = figure.subplots()
    whole = planes.whole_of(barrier)
    classes = np.array([style.circle_class(text, whole) for text in barrier.circle.values])
    planes.fill_inside(axes, barrier)
    axes.plot(*planes.in_plane(barrier), color="0.4", lw=0.8, zorder=2)
    styles = style.circle_styles(barrier.circle.values, whole)
    style.draw_points(axes, *planes.in_plane(barrier), classes, styles, 3.5, zorder=3)
    axes.text(0, 0.2, "a barrier exists", ha="center")
    axes.text(0, 0.85, "global transport", ha="center")
    planes.label_plane(axes, barrier)
    named = style.longest_arcs(barrier.angle.values, classes)
    style.name_circles(axes, {text: styles[text] for text in named})
    handles, labels = axes.get_legend_handles_labels()
    title = rf"last circle: $\omega$, or ${whole} - \omega$"
    style.outer_legend(figure, 4, 2, handles=handles, labels=labels, title=title)
    keep(figure, "boundary", 100)


def proved_map(cube):
    barrier = unfolded(cube("barrier"), np.linspace(0, 45, 91))
    whole = everywhere(cube("proved_map").load(), barrier)
    drawn = draw_proved_map(whole, cube("proved_triangles"), barrier)
    keep(drawn, "proved_map", 150)


def work_precision(cube):
    keep(draw_work_precision(cube("work_precision")), "work_precision", 80)


def explorer(out):
    """Take a screenshot of the explorer with one forcing selected."""
    from playwright.sync_api import sync_playwright

    command = [sys.executable, "-m", "workflows.explore", "--port", "0", "--no-browser"]
    command += ["--out", str(out)]
    with (
        subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process,
        sync_playwright() as driver,
    ):
        messages = "".join(iter(process.stderr.readline, "Ctrl-C ends it\n"))
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"))
        tab = browser.new_page(viewport={"width": 1400, "height": 900})
        tab.set_default_timeout(PATIENCE)
        tab.goto(re.search(r"http://localhost:\d+/", messages).group() + "?k1=0.3&k2=0.5")
        tab.get_by_text("ready", exact=True).wait_for()
        tab.screenshot(path=HERE / "explorer.jpg", quality=80, full_page=True)
        browser.close()
        process.send_signal(signal.SIGINT)


def main(out):
    for draw, name in (
        (boundary, "critical_boundary"),
        (proved_map, "proved_map"),
        (work_precision, "work_precision"),
    ):
        place = out / name
        try:
            with style.sheet():
                draw(lambda cube, place=place: xr.open_zarr(place / f"{cube}.zarr").load())
        except FileNotFoundError:
            command = f"python -m workflows.{name} --out {place}"
            print(f"No cubes in {place}; {draw.__name__}.png is unchanged. Compute: {command}")
    explorer(out / "critical_boundary")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
