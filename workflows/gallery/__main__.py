"""The paper reproduced: every figure with its caption, its command and its numbers, on one page.

Runs the commands for Figs. 1 to 11 of arXiv:1606.04824 and for additional results one after
another, each in its own directory in OUT, all on the same workers, and writes OUT/index.html. Each
command resumes an earlier run. Below the figures of a command the page shows a few lines of Python
that read its cubes and redraw the main result; OUT/recipes contains these lines as scripts and
notebooks, to be run in OUT.

By default, the command runs a preview of everything, which takes about ten CPU minutes.
"""

import json
import re
from datetime import date
from pathlib import Path

import click

from workflows.figures import files
from workflows.gallery.exhibits import command_of, listed, run
from workflows.shared.cli import (
    DIRECTORY,
    choice,
    cluster_options,
    command,
    directory,
    flag,
    quiet_option,
)

EXHIBITS = listed("exhibits.toml")


def recipes():
    """Return the recipes in `recipes.md` as a dict {command: script}."""
    text = Path(__file__).with_name("recipes.md").read_text(encoding="utf-8")
    return dict(re.findall(r"^## (\w+)\n\n```python\n(.*?)^```$", text, re.M | re.S))


def recipe(name, out):
    """Write the recipe of a command to OUT/recipes, as a script and a notebook; return the script.

    The notebook contains the docstring as a text cell, and the rest as a code cell.
    """
    script = recipes()[name]
    _, docstring, code = script.split('"""', 2)
    text_cell = {"id": "text", "cell_type": "markdown", "metadata": {}, "source": docstring}
    code_cell = {"id": "code", "cell_type": "code", "metadata": {}, "source": code.strip()}
    code_cell |= {"execution_count": None, "outputs": []}
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    header = {"metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}
    notebook = json.dumps({"cells": [text_cell, code_cell], **header}, indent=1, ensure_ascii=False)
    Path(out, "recipes").mkdir(exist_ok=True)
    for kind, content in (("py", script), ("ipynb", notebook)):
        files.write(f"{out}/recipes/{name}.{kind}", content)
    return script


def section_of(exhibit, out, quick):
    """Return, as a dict, the template values for a command's section of the page."""
    folder, name = Path(out, exhibit.name), exhibit.name
    texts = {path.stem: path.read_text(encoding="utf-8").strip() for path in folder.glob("*.txt")}
    others = sorted(path for kind in ("pdf", "csv", "html") for path in folder.glob(f"*.{kind}"))
    pictures = sorted(folder.glob("*.png"))
    return vars(exhibit) | {
        "command": command_of(exhibit, quick),
        "pictures": [(f"{name}/{path.name}", texts.get(path.stem, "")) for path in pictures],
        "files": [f"{name}/{path.name}" for path in others],
        "cubes": [f"{name}/{path.name}" for path in sorted(folder.glob("*.zarr"))],
        "recipe": recipe(name, out),
    }


_NAMES = [exhibit.name for exhibit in EXHIBITS]
_RELEASE = (
    "Instead, write the data set for a DOI to DIR: boundaries, reference values, a proved map with "
    "certificates, a licence, checksums, and metadata for Zenodo. This takes an hour of CPU time. "
    "With --full, write only the proved map, in full, which takes about a CPU hour."
)


@command()
@flag("--full", "Use the sizes from the paper; about four CPU hours; needs --yes or --scheduler.")
@flag("--yes", "Run --full although it takes hours.")
@choice("--exhibit", _NAMES, (), "Command to run; may be repeated.  [default: all]", multiple=True)
@click.option("--release", metavar="DIR", type=DIRECTORY, help=_RELEASE)
@flag("--quick", "A preview of the release, with a few rays and cells.")
@directory("Directory of the page, with a folder for each command; earlier runs are resumed.")
@quiet_option
@cluster_options
def main(out, full, yes, exhibit, release, quick, quiet, workers, scheduler, tls):
    from pandas import read_csv

    from nasm import __version__
    from pipeline.sweep.progress import plural
    from workflows.gallery.release import FULL_MAP, RELEASE, make_release
    from workflows.shared.page import render
    from workflows.shared.run import shared_workers

    if release or quick:
        if not release or exhibit or (quick and full):
            raise click.UsageError(
                "combine --release with --quick or --full only, and --quick with --release only"
            )
        if full and not (yes or scheduler):
            raise click.UsageError("--release with --full takes about a CPU hour; add --yes")
        with shared_workers(scheduler, workers, tls) as workers:
            exhibits = FULL_MAP if full else RELEASE
            size = make_release(release, exhibits, workers, quick, quiet)
        click.echo(f"release: {release}, {size / 1e6:.1f} MB")
        return
    if full and not (yes or scheduler):
        message = "--full takes about four CPU hours; omit it for a preview, or add --yes"
        raise click.UsageError(message)
    Path(out).mkdir(parents=True, exist_ok=True)
    quick = not full
    selected = [each for each in EXHIBITS if not exhibit or each.name in exhibit]
    with shared_workers(scheduler, workers, tls) as workers:
        for number, each in enumerate(selected, 1):
            if not quiet:
                click.echo(f"\nexhibit {number} of {len(selected)}", err=True, nl=False)
            run(each, out, workers, quick, quiet)
            # The page is updated after each command.
            finished = [each for each in EXHIBITS if Path(out, each.name).exists()]
            claims, summary, table = [], "", Path(out, "claims", "claims.csv")
            if table.exists():
                claims = read_csv(table, keep_default_na=False).to_dict("records")
                summary = table.with_suffix(".txt").read_text(encoding="utf-8").strip()
            render(
                "gallery/page.html",
                f"{out}/index.html",
                sections=[section_of(each, out, quick) for each in finished],
                claims=claims,
                summary=summary,
                quick=quick,
                made=f"{date.today():%d %B %Y}, nasm {__version__}",
            )
    n_figures = sum(1 for _ in Path(out).glob("*/*.png"))
    parts = plural(n_figures, "figure"), plural(len(finished), "command")
    click.echo(f"\n{' from '.join(parts)} on one page. {summary}".rstrip())
    click.echo(f"page: {out}/index.html")
