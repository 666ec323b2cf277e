"""The generated parts of the site: tables, a page for each module, and the gallery."""

import json
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import nasm
import pipeline
from nasm.numbers import parse
from nasm.planes import two_kicks
from nasm.results import Status
from pipeline.cubes import (
    barrier,
    beyond,
    breakdown,
    escape,
    forcings,
    frequency_map,
    indicators,
    proved,
    rotating_maps,
)
from pipeline.cubes.cube import Job, status_code
from pipeline.sweep.grid import Axis
from workflows.gallery.exhibits import command_of, listed
from workflows.reference.writing import HEADER, sections
from workflows.shared.cli import commands

ROOT = Path(__file__).parents[1]
GALLERY = ROOT / "out" / "gallery"
VALUES = Path(__file__).parent / "reference" / "values.json"


def markdown(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    texts = ([str(cell).replace("|", "\\|") for cell in line] for line in lines)
    return "".join(f"| {' | '.join(line)} |\n" for line in texts)


def jobs() -> list[Job]:
    """Return one Job for each kind of cube, without computing anything."""
    plane, angles, excesses = two_kicks(), [0.0, 45.0], [0.01]
    scales, circles = {45.0: 1.374}, {45.0: "2gamma"}
    axes = [Axis(0, 1, 8), Axis(0, 1, 8)]
    random = [("random", 1.0, [1.0, 0.5, 0.2])]
    return [
        barrier.last_barrier(plane, angles, 1e-4),
        breakdown.by_continuation(plane, [parse("gamma")], angles, 1e-4),
        escape.over_plane("escape", plane, axes, [16], 1000, 4),
        breakdown.by_escape(plane, angles, 1000, 100),
        proved.proved_barrier(plane, angles, 1.0),
        proved.proved_map(two_kicks(), [(0.0, 1.0), (45.0, 1.2)], 64, 1.0),
        proved.proved_triangles(two_kicks(), [(0.0, 1.0), (45.0, 1.2)], ["gamma", "2gamma"], 0.1),
        proved.proved_forcings("labels_proofs", [(0.4, 0.0, -0.17)], ["gamma"]),
        indicators.indicators("labels_indicators", [0.4], [0.0], [100, 1000]),
        beyond.flux(plane, scales, circles, excesses, 3000),
        beyond.diffusion(scales, excesses, 100, 10_000),
        forcings.last_barriers("patterns", random, "parameter", 1e-3),
        frequency_map.frequency_map((0.3, 0.2), axes, 1000, 8),
        rotating_maps.breakups([(0.618, 0.414)], angles, 1e-2),
        rotating_maps.ripples([Fraction(1, 3)], [0.1], 1e-2),
    ]


def cubes() -> str:
    """Return a table of the variables and their dims for each kind of cube."""
    parts = []
    for job in jobs():
        template = job.cube.template
        rows = [
            (f"`{name}`", ", ".join(map(str, array.dims)), array.attrs.get("units", ""), meaning)
            for name, array in template.variables.items()
            if (meaning := array.attrs.get("long_name"))
        ]
        title = template.attrs.get("title", "")
        parts.append(f"## `{job.cube.name}`\n\n{title}.\n\n")
        parts.append(markdown(("variable", "dims", "units", "meaning"), rows) + "\n")
    return "".join(parts)


def statuses() -> str:
    return markdown(
        ("code", "status", "meaning, and what to do"),
        ((status_code(status), f"`{status.name.lower()}`", status.value) for status in Status),
    )


def trust() -> str:
    """Return a table of how often methods keep their promises; † marks code that has changed."""
    from measure_trust import MEASURED, has_changed, read

    rows = read(MEASURED)
    head = "method", "promise", "sample", "kept", "worst ratio", "CPU s", "command"
    lines = [
        (
            f"`{'.'.join(row['method'].split('.')[1:][-2:])}`{' †' * has_changed(row)}",
            row["promise"],
            f"{row['asked']} {row['sample']}",
            f"{int(row['answered']) - int(row['broken'])} of {row['answered']}",
            row["worst ratio"],
            f"{row['CPU s, median']} ({row['CPU s, largest']})" if row["CPU s, median"] else "",
            row["command"].split()[-1].removeprefix("workflows.").removeprefix(".docs/"),
        )
        for row in rows
    ]
    return markdown(head, lines) + "\n" + measured(rows)


def measured(rows: Sequence[Mapping[str, str]]) -> str:
    """Return a sentence that states when rows were measured, and whether code has changed since."""
    from measure_trust import has_changed

    dates = " and ".join(sorted({row["date"] for row in rows}))
    changed = " †: the code has changed since." if any(map(has_changed, rows)) else ""
    return f"Measured on {dates}.{changed}\n"


def claims() -> str:
    """Count the verdicts on the paper's claims, by section; † marks code that has since changed."""
    from measure_trust import CLAIMS_HEAD, JUDGED, has_changed, read

    rows, shown = read(JUDGED), CLAIMS_HEAD[:-2]
    if not rows:
        return "*This copy of the site was built before the claims were judged.*\n"
    total = ["all", *(sum(int(row[name]) for row in rows) for name in shown[1:])]
    lines = [[row["section"] + " †" * has_changed(row), *map(row.get, shown[1:])] for row in rows]
    return markdown(shown, [*lines, total]) + "\n" + measured(rows)


def values() -> str:
    """Return the reference values of `reference/values.json`, with one section for each kind."""
    document = json.loads(VALUES.read_text(encoding="utf-8"))
    parts = [f"{document['conventions']}\n\n"]
    for section in sections(document["values"]):
        parts.append(
            f"## {section['title']}\n\n{section['definition']}. Unit: {section['unit']}.\n\n"
        )
        parts.append(
            f"*First method*: {section['method']}. *Second*: {section['second_method']}.\n\n"
        )
        parts.append(markdown(HEADER, [row for row, _ in section["rows"]]) + "\n")
        parts.append(f"The first value in the table is computed by `{section['command']}`.\n\n")
        if section["check"]:
            parts.append(
                f"Plain Python that checks a value in the table, to a relative accuracy of "
                f"{section['accuracy']:g}:\n\n"
            )
            parts.append(f"```{{code-block}} python\n{section['check']}\n```\n\n")
    return "".join(parts)


def sample() -> str:
    """Return a table that counts judged forcings by class and by the method that judged them."""
    sys.path.insert(0, str(ROOT / "tests"))
    from judged import table

    rows = table().values()
    methods = sorted({row.method.split(" ")[0] for row in rows})
    counts = Counter((row.kind, row.method.split(" ")[0]) for row in rows)
    return markdown(
        ("class of forcing", *methods),
        (
            (kind, *(counts[kind, method] or "" for method in methods))
            for kind in dict.fromkeys(row.kind for row in rows)
        ),
    )


def command_options() -> str:
    """Return the directives that make sphinx-click insert the help text of each command."""
    parts = []
    for name in commands():
        module = f"workflows.{name}"
        if (ROOT / "workflows" / name).is_dir():
            module += ".__main__"
        directive = f".. click:: {module}:main\n   :prog: python -m workflows.{name}\n"
        parts.append(f"```{{eval-rst}}\n{directive}```\n\n")
    return "".join(parts)


def gallery() -> str:
    """Return the exhibits of the gallery: their commands, and their figures if already drawn.

    Pictures come from `out/gallery`; links point to the copy that `conf.py` puts into the site.
    """
    parts = []
    if (GALLERY / "index.html").exists():
        link = '<a href="gallery/index.html">All figures, tables and claims on one page</a>'
        parts.append(f"{link}, with the Python code that draws each of them.\n\n")
    else:
        parts.append("*This copy of the site was built without the figures.*\n\n")
    for exhibit in listed("exhibits.toml"):
        parts.append(f"## {exhibit.title}\n\n`{command_of(exhibit, quick=True)}`\n\n")
        for picture in sorted((GALLERY / exhibit.name).glob("*.png"))[:1]:
            caption = picture.with_suffix(".txt").read_text(encoding="utf-8").strip()
            place = f"../out/gallery/{exhibit.name}/{picture.name}"
            options = f":alt: {exhibit.title}\n:width: 100%\n"
            parts.append(f"```{{figure}} {place}\n{options}\n{caption}\n```\n\n")
    return "".join(parts)


def write_modules(folder: Path) -> str:
    """Write a page for each module of `nasm` and `pipeline`; return the table that lists them."""
    folder.mkdir(exist_ok=True)
    rows = []
    for package in nasm, pipeline:
        for info in walk_packages(package.__path__, f"{package.__name__}."):
            if info.ispkg:
                continue
            name = info.name
            about = (import_module(name).__doc__ or "").partition("\n")[0]
            page = f"# {name}\n\n```{{eval-rst}}\n.. automodule:: {name}\n```\n"
            (folder / f"{name}.md").write_text(page, encoding="utf-8")
            rows.append((f"[{name}](api/{name}.md)", about))
    return markdown(("module", "contents"), rows)


def write(folder: Path) -> None:
    """Write all tables into a folder, as files that pages include."""
    folder.mkdir(exist_ok=True)
    (folder / "modules.md").write_text(write_modules(folder / "api"), encoding="utf-8")
    for table in command_options, cubes, statuses, trust, claims, values, sample, gallery:
        (folder / f"{table.__name__}.md").write_text(table(), encoding="utf-8")
