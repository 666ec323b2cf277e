"""The paper, regenerated: every figure with its caption, its command and its numbers, on one page.

Runs one workflow after the other (arXiv:1606.04824, Figs. 1 to 11, and what goes beyond them), each
into a directory of its own in OUT, all on the same workers, and writes OUT/index.html. Each of them
resumes by itself.
"""

import shlex
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import click

from workflows.cli import HELP, cluster_options, shared_workers


@dataclass(frozen=True)
class Exhibit:
    """A workflow, what it shows, and its options for a preview, and for the paper's size."""

    title: str
    workflow: str
    quick: str = ""
    full: str = ""


EXHIBITS = (
    Exhibit("Figures 1 and 2: phase portraits", "portraits"),
    Exhibit("Figures 3 and 4: period-one orbits", "period_one"),
    Exhibit(
        "Figures 5 and 6: the boundary by direct iteration",
        "direct_boundary",
        "--angles 37 --n-orbits 100 --steps 1000,5000,10000",
    ),
    Exhibit(
        "Figure 7: convergence",
        "convergence",
        "--quick --n-orbits 10,100",
        "--n-orbits 10,100,1000,10000",
    ),
    Exhibit(
        "Figures 8 and 9: boundaries of circles",
        "circle_boundaries",
        "--angles 61 --tips 6 --tol 1e-3 --q-max 1500",
    ),
    Exhibit(
        "Figures 10 and 11: rotating standard maps",
        "rotating",
        "--angles 61 --n-max 2000 --n-orbits 64",
    ),
    Exhibit(
        "Three kicks: the rotating map of Ω = 1/3",
        "three_kicks",
        "--angles 19 --tips 0 --phase 0 --phase 1/12 --n-max 100",
    ),
    Exhibit("The last barrier, from both sides", "last_barrier", "--angles 61 --tips 6 --tol 1e-3"),
    Exhibit("The flux through the last circle, broken", "flux", "--nearest 1e-3"),
    Exhibit(
        "Claims of the paper",
        "claims",
        "--angles 19 --tips 8 --tol 1e-3 --n-max 20000 --n-orbits 64",
    ),
)


def run(exhibit, out, workers, quick):
    """Run the workflow as its command line would; returns that command."""
    options = (exhibit.quick if quick else exhibit.full).split()
    place = ["--out", f"{out}/{exhibit.workflow}"]
    main = import_module(f"workflows.{exhibit.workflow}").main
    swept = any(option.name == "scheduler" for option in main.params)
    click.echo(f"\n{exhibit.title}", err=True)
    main.main([*options, *place, *(workers if swept else [])], standalone_mode=False)
    return shlex.join(["python", "-m", f"workflows.{exhibit.workflow}", *options, *place])


def exhibit_section(exhibit, command, out):
    """The part of the page that shows what the workflow has written."""
    from workflows import page

    here = Path(out) / exhibit.workflow
    parts = [page.heading(exhibit.title), page.paragraph(page.code(command))]
    for picture in sorted(here.glob("*.png")):
        caption = picture.with_suffix(".txt")
        text = caption.read_text(encoding="utf-8").strip() if caption.exists() else ""
        parts.append(page.figure(f"{exhibit.workflow}/{picture.name}", text))
    files = sorted([*here.glob("*.pdf"), *here.glob("*.csv"), *here.glob("*.html")])
    links = [page.link(f"{exhibit.workflow}/{file.name}", file.name) for file in files]
    links.append(page.code(f"{exhibit.workflow}/cubes.zarr"))
    parts.append(page.paragraph(*(part for link in links for part in (link, " "))))
    return page.Markup("\n".join(parts))


@click.command(context_settings={**HELP, "default_map": {"out": "gallery"}})
@click.option("--quick", is_flag=True, help="A preview of everything, in a few minutes.")
@click.option(
    "--only",
    multiple=True,
    type=click.Choice([exhibit.workflow for exhibit in EXHIBITS]),
    help="A workflow to run; may be repeated.  [default: all]",
)
@cluster_options
def main(out, cluster, quick, only):
    """The paper, regenerated: all figures and claims, and the page OUT/index.html that shows them.

    The full size, as in the paper, takes hours on two cores, nearly all of them direct iteration.
    """
    from workflows import page

    chosen = [exhibit for exhibit in EXHIBITS if not only or exhibit.workflow in only]
    with shared_workers(**cluster) as workers:
        sections = []
        for exhibit in chosen:
            command = run(exhibit, out, workers, quick)
            sections.append(exhibit_section(exhibit, command, out))
            # After each of them, so that there is something to see.
            text = page.page("Global transport in a nonautonomous standard map", *sections)
            Path(out, "index.html").write_text(text, encoding="utf-8")
    click.echo(f"page: {out}/index.html")


if __name__ == "__main__":
    main()
