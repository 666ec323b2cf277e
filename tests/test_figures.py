"""Figures: the styles of circles, and properties that all figures share."""

import os
import subprocess
import sys
from functools import partial
from itertools import combinations, pairwise, product
from pathlib import Path

import matplotlib
import numpy as np
import pytest
import xarray as xr
from commands import invoke
from figure_faults import faults
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image
from sketches import SAVE

from nasm.numbers import NAMES, parse
from nasm.planes import three_kicks as three_kicks_plane
from pipeline.sweep.grid import parse_axis
from workflows.figures import style
from workflows.figures.last_barrier import draw_last_barrier
from workflows.figures.period_one import draw_secondary_points
from workflows.figures.style import circle_class, circle_style
from workflows.shared.cli import main_of
from workflows.shared.period_one import secondary_dataset

ROOT = Path(__file__).parents[1]

# Matrices from linear RGB to what a dichromat sees (Machado, Oliveira & Fernandes 2009,
# severity 1).
DICHROMATS = {
    "deuteranope": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "protanope": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
}
XYZ = [
    [0.4124564, 0.3575761, 0.1804375],
    [0.2126729, 0.7151522, 0.0721750],
    [0.0193339, 0.1191920, 0.9503041],
]
ON_THE_BOUNDARY = [
    "[0;(1)]",
    "[0;1,2,(1)]",
    "[0;1,3,(1)]",
    "[0;1,3,2,(1)]",
    "[0;1,3,3,(1)]",
    "[0;1,3,4,2,(1)]",
]
NEAR_THE_CUSP = ["[0;1,3,4,3,(1)]", "[0;1,3,4,4,(1)]", "[0;1,3,4,4,2,(1)]", "[0;1,3,(4)]"]


def lab(colour, seen_by):
    """Return the CIE L*a*b* coordinates (white point D65) of an sRGB colour seen by a dichromat."""
    rgb = np.array(to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.array(DICHROMATS[seen_by]) @ linear, 0, 1)
    t = np.array(XYZ) @ seen / np.sum(XYZ, axis=1)
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("seen_by", DICHROMATS)
def test_colour_blind_readers_can_distinguish_all_circles_and_greys(seen_by):
    greys = ["black", "white", style.INSIDE, style.NO_ESCAPE, "0.5"]
    pairs = [*combinations(style.COLOURS, 2), *product(style.COLOURS, greys)]
    apart = {(a, b): np.linalg.norm(lab(a, seen_by) - lab(b, seen_by)) for a, b in pairs}
    assert min(apart.values()) >= 17, min(apart, key=apart.get)


def test_circles_that_meet_on_the_boundary_differ_in_colour():
    looks = [circle_style(text, 1) for text in ON_THE_BOUNDARY + NEAR_THE_CUSP]
    assert len({look["color"] for look in looks[: len(ON_THE_BOUNDARY)]}) == len(ON_THE_BOUNDARY)
    assert all(a["color"] != b["color"] for a, b in pairwise(looks))
    assert len({(look["color"], look["marker"]) for look in looks}) == len(looks)


def test_the_six_circles_of_the_paper_differ_and_the_golden_one_is_blue():
    looks = [circle_style(str(parse(name)), 1) for name in NAMES]
    assert len({(look["color"], look["ls"]) for look in looks}) == len(NAMES)
    assert looks[0] == {"color": style.COLOURS[0], "marker": "o", "ls": "-"}


def test_no_two_circles_look_alike_and_simple_ones_keep_their_style():
    """The test includes three-kick circles that look alike by default, and 60 from a tree."""
    alike = ["[0;1,3,(1)]", "[0;2,2,(1)]", "[1;3,(1)]"]
    assert len({str(circle_style(text)) for text in alike}) == 1
    tree = [f"[0;{a},{b},{c},(1)]" for a, b, c in product(range(1, 5), range(1, 6), range(2, 5))]
    for texts in (alike, [*tree, ""], ON_THE_BOUNDARY + NEAR_THE_CUSP):
        styles = style.circle_styles(texts)
        assert styles == style.circle_styles(texts[::-1])
        assert [*styles] == sorted(texts, key=lambda text: float(parse(text)) if text else 2)
        for what in ("marker", "ls"):
            looks = {(look["color"], str(look[what])) for text, look in styles.items() if text}
            assert len(looks) == len([text for text in texts if text])
    styles = style.circle_styles([*alike, "[0;(1)]"])
    assert styles["[0;(1)]"] == circle_style("[0;(1)]")
    assert styles["[1;3,(1)]"] == circle_style("[1;3,(1)]")


def test_a_circle_and_its_image_look_alike_only_if_the_symmetry_holds():
    one, image = "[0;1,3,(1)]", "[0;4,(1)]"
    assert circle_class(image) == one
    assert circle_style(one, 1) == circle_style(image, 1) == circle_style(one)
    assert circle_style(one)["color"] != circle_style(image)["color"]


def test_the_longest_arcs_come_first_and_those_below_1_percent_are_omitted():
    angles = np.linspace(0, 90, 361)
    classes = np.full(361, "[0;(1)]", dtype=object)
    classes[:250], classes[300], classes[310:] = "[0;1,2,(1)]", "[0;1,3,(1)]", ""
    assert style.longest_arcs(angles, classes) == ["[0;1,2,(1)]", "[0;(1)]"]


def test_the_picture_of_the_boundary_has_the_colours_of_its_circles():
    with Image.open(ROOT / ".readme/boundary.png") as picture:
        assert picture.mode == "RGB"  # a palette would mix colours
        shown = np.asarray(picture).reshape(-1, 3)
    for text in ON_THE_BOUNDARY[:4]:
        colour = np.rint(255 * np.array(to_rgb(circle_style(text)["color"])))
        assert (shown == colour).all(axis=1).sum() > 100, text


def test_a_figure_is_as_wide_as_its_column_with_letters_instead_of_titles(tmp_path, monkeypatch):
    monkeypatch.setattr(Figure, "savefig", SAVE)
    with style.sheet(column=True):
        figure, drawn = style.panels(1, 2, 12, 5)
        for axes in drawn:
            axes.set_title("a title")
        figure.suptitle("another title")
        path, pdf = style.save(figure, tmp_path, "narrow", "what it shows")
    assert Path(pdf).read_bytes().startswith(b"%PDF")
    assert (tmp_path / "narrow_column.txt").read_text() == "what it shows\n"
    with Image.open(path) as picture:
        assert picture.info["Description"] == "what it shows"
        assert picture.width / picture.info["dpi"][0] == pytest.approx(style.COLUMN, abs=0.01)
    words = [text.get_text() for text in figure.findobj(Text)]
    assert {"(a)", "(b)"} <= set(words)
    assert not any("title" in word for word in words)
    assert all(text.get_fontsize() >= 6.5 for text in figure.findobj(Text))
    assert not style.in_column()


def hostile_settings():
    """Return a value other than the default for nearly every setting of a matplotlibrc."""
    settings = matplotlib.RcParams()
    values = "True", "False", "7", "0.3", "7, 5", "0.2, 0.4", "tight", "png", "svg", "pdf", "red"
    values += "none", "serif", "cm", "round", "top", "in", "left", "both", "s", "--", "42", "gray"
    values += "1, 2, 3", "major", "center", "log", "cividis", "full", "zoom", "8.5", "a, b", "y"
    different = {}
    for name, default in matplotlib.rcParamsDefault.items():
        for value in values:
            try:
                settings[name] = value
            except (ValueError, RuntimeError):
                continue
            if settings[name] != default:
                different[name] = value
                break
    return different


def draw_under_any_matplotlibrc(out):
    """Draw a figure with a colour bar, a legend and contours."""
    draw = partial(draw_secondary_points, secondary_dataset(parse_axis("0:8:12")))
    paths, reason = style.drawn(draw, out, "secondary", "words")
    assert len(paths) == 2, reason


@pytest.mark.slow
def test_no_matplotlibrc_changes_a_figure(tmp_path, monkeypatch):
    monkeypatch.setattr(Figure, "savefig", SAVE)
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")  # for the dates in PDFs
    hostile, ours, theirs = (tmp_path / name for name in ("matplotlibrc", "ours", "theirs"))
    settings = hostile_settings()
    assert len(settings) > 0.9 * len(matplotlib.rcParamsDefault)
    assert {"figure.autolayout", "text.usetex", "savefig.bbox", "font.family"} <= {*settings}
    hostile.write_text("".join(f"{name}: {value}\n" for name, value in settings.items()))
    for out in (ours, theirs):
        out.mkdir()
    draw_under_any_matplotlibrc(ours)
    script = """
import sys
import matplotlib
from test_figures import draw_under_any_matplotlibrc
changed = [name for name in matplotlib.rcParams
           if name != "backend" and matplotlib.rcParams[name] != matplotlib.rcParamsDefault[name]]
draw_under_any_matplotlibrc(sys.argv[1])
print(len(changed))
"""
    environment = os.environ | {"MATPLOTLIBRC": str(hostile)}
    environment["PYTHONPATH"] = str(Path(__file__).parent)
    command = [sys.executable, "-c", script, str(theirs)]
    ended = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    assert int(ended.stdout) > 0.9 * len(settings)  # the matplotlibrc was read
    for path in ours.iterdir():
        assert (theirs / path.name).read_bytes() == path.read_bytes(), path.name


def test_if_a_figure_cannot_be_drawn_results_and_other_figures_are_kept(tmp_path, monkeypatch):
    def failing(_):
        raise RuntimeError("no layout for this\nand more")

    monkeypatch.setattr("workflows.figures.period_one.draw_primary_points", failing)
    small = "--primary", "-4:4:10", "--secondary", "0:8:10"
    ended = invoke("period_one", tmp_path, *small)
    assert ended.exit_code == 1
    assert (
        "Error: figure period_one_primary could not be drawn: no layout for this\n" in ended.output
    )
    first, second = (ended.output.index(words) for words in ("Strengths for", "cubes:"))
    assert first < second < ended.output.index("figures:") < ended.output.index("Error:")
    assert {path.name for path in tmp_path.glob("*.png")} == {"period_one_secondary.png"}


def test_findings_are_printed_before_figures_are_drawn(tmp_path, monkeypatch, capsys):
    output = []
    monkeypatch.setattr(style, "save", lambda *_: output.append(capsys.readouterr().out) or [])
    monkeypatch.setattr("workflows.figures.period_one.draw_primary_points", lambda _: None)
    monkeypatch.setattr("workflows.figures.period_one.draw_secondary_points", lambda _: None)
    options = ["--out", str(tmp_path), "--primary", "-4:4:10", "--secondary", "0:8:10"]
    main_of("period_one").main(options, standalone_mode=False)
    assert "Secondary period-one orbits" in output[0]
    assert "cubes:" in output[0]


def test_ask_answers_even_if_its_portrait_cannot_be_drawn(tmp_path, monkeypatch):
    def failing(*_):
        raise OSError(24, "Too many open files")

    monkeypatch.setattr("workflows.figures.ask.draw_verdict", failing)
    ended = invoke("ask", tmp_path, "0.3", "0.2")
    assert ended.exit_code == 1
    assert ended.output.startswith("BARRIER at")
    assert "Error: figure ask_0.3_0.2 could not be drawn: [Errno 24] Too many" in ended.output


def wrong_figure():
    figure, (left, right) = style.panels(1, 2, 8, 3)
    left.plot([0, 1, 2], [0, 1, 0], "o", label="one")
    left.plot([0, 3], [0, 2], "o-")
    left.set(xlim=(0, 2), ylim=(0, None))
    left.text(1, 1, "on a point", ha="center", va="center")
    left.text(1, 1, "twice", ha="center", va="center")
    right.plot([0, 1], [0, 1], label="a curve")
    right.plot([], [], label="alike", color="C0")
    right.legend(loc="center")
    return figure


def test_faults_in_a_figure_are_detected():
    with style.sheet(column=True):
        figure = wrong_figure()
        style.finish(figure)
        figure.text(0.9, 0.5, "text that is far too long for a column")
        output = "\n".join(faults(figure))
    for words in ("is cut by the edge", "'on a point' is printed over 'twice'", "lies on", "alike"):
        assert words in output
    assert "a legend lies on" in output
    assert "markers 'o' are cut" in output


def test_a_saved_figure_has_no_blank_strips_and_its_legend_is_close_by(tmp_path, monkeypatch):
    monkeypatch.setattr(Figure, "savefig", SAVE)
    for column in (False, True):
        with style.sheet(column):
            figure, (axes,) = style.panels(1, 1, 4, 9)
            axes.plot([0, 1], [0, 1], "o", label="words")
            axes.set(aspect="equal", xlim=(0, 1), ylim=(0, 1))
            style.outer_legend(figure, 1)
            (path,) = style.save(figure, tmp_path, "tall", kinds=["png"])
        with Image.open(path) as picture:
            inked = np.asarray(picture.convert("L")).min(axis=1) < 250
        rows = np.flatnonzero(inked)
        assert rows[0] < 0.03 * inked.size
        assert rows[-1] > 0.97 * inked.size
        assert np.diff(rows).max() < 0.08 * inked.size
        assert faults(figure) == []


@pytest.fixture(scope="module")
def around():
    """Return CB_gt in a plane without symmetry; by default some of its circles look alike."""
    angles = np.linspace(0, 360, 25)
    texts = [
        *ON_THE_BOUNDARY,
        "[0;2,2,(1)]",
        "[1;3,(1)]",
        "[0;3,(1)]",
        "[0;5,(1)]",
        "[1;2,(1)]",
        "",
    ]
    circle = np.resize(np.array(texts, dtype=object), angles.size)
    scale = np.where(circle == "", np.nan, 0.5 + 0.1 * np.sin(3 * np.deg2rad(angles)))
    plane = three_kicks_plane(0.15)
    x, y = scale * np.cos(np.deg2rad(angles)), scale * np.sin(np.deg2rad(angles))
    omega = [float(parse(text)) if text else np.nan for text in circle]
    columns = {"circle": circle, "critical_scale": scale, "lower": 0.999 * scale, "omega": omega}
    columns |= {"upper": 1.001 * scale} | dict(zip(plane.axes, (x, y), strict=True))
    data = {name: ("angle", values) for name, values in columns.items()}
    return xr.Dataset(data, {"angle": angles}, plane.record)


@pytest.mark.parametrize("column", [False, True])
def test_last_barriers_in_any_plane_are_named_and_no_two_look_alike(around, column):
    with style.sheet(column):
        figure = draw_last_barrier(around)
        style.finish(figure)
        assert faults(figure) == []
    (legend,) = figure.legends
    named = [text.get_text() for text in legend.get_texts()]
    shown = {text for text in around.circle.values if text}
    assert len(named) == len(shown) + 1  # one more for ×, which marks rays without an answer
    assert all(any(f"{text}$" in words for words in named) for text in shown)
