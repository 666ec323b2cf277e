"""The paper, regenerated: every figure with its caption, its command and its numbers, on one page.

Runs one command after the other (arXiv:1606.04824, Figs. 1 to 11, and what goes beyond them), each
into a directory of its own in OUT, all on the same workers, and writes OUT/index.html. Each of them
resumes by itself.
"""

import shlex
from dataclasses import dataclass
from pathlib import Path

import click

from workflows.parts.cli import cluster_options, command, main_of, out_option, shared_workers


@dataclass(frozen=True)
class Exhibit:
    """A command, what it shows, and its options for a preview and for the paper's size."""

    title: str
    name: str
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


def show(exhibit, out, workers, quick):
    """Run the command; return what the page shows of it."""
    options = (exhibit.quick if quick else exhibit.full).split()
    options += ["--out", f"{out}/{exhibit.name}"]
    main = main_of(exhibit.name)
    swept = any(option.name == "scheduler" for option in main.params)
    click.echo(f"\n{exhibit.title}", err=True)
    main.main([*options, *(workers if swept else [])], standalone_mode=False)
    here = Path(out, exhibit.name)
    texts = {path.stem: path.read_text(encoding="utf-8").strip() for path in here.glob("*.txt")}
    files = sorted(path for kind in ("pdf", "csv", "html") for path in here.glob(f"*.{kind}"))
    return {
        "title": exhibit.title,
        "command": shlex.join(["python", "-m", f"workflows.{exhibit.name}", *options]),
        "pictures": [
            (f"{exhibit.name}/{path.name}", texts.get(path.stem, ""))
            for path in sorted(here.glob("*.png"))
        ],
        "files": [f"{exhibit.name}/{path.name}" for path in files],
        "cubes": [f"{exhibit.name}/{path.name}" for path in sorted(here.glob("*.zarr"))],
    }


@command(default_map={"out": "gallery"})
@click.option("--quick", is_flag=True, help="A preview of everything, in a few minutes.")
@click.option(
    "--only",
    multiple=True,
    type=click.Choice([exhibit.name for exhibit in EXHIBITS]),
    help="A command to run; may be repeated.  [default: all]",
)
@out_option
@cluster_options
def main(out, quick, only, workers, scheduler, tls):
    """The paper, regenerated: all figures and claims, and the page OUT/index.html that shows them.

    The full size, as in the paper, takes hours on two cores, nearly all of them direct iteration.
    """
    from workflows.parts.page import render

    sections = []
    Path(out).mkdir(parents=True, exist_ok=True)
    with shared_workers(scheduler, workers, tls) as workers:
        for exhibit in EXHIBITS:
            if not only or exhibit.name in only:
                sections.append(show(exhibit, out, workers, quick))
                # After each of them, so that there is something to see.
                render("parts/gallery.html", f"{out}/index.html", sections=sections)
    click.echo(f"page: {out}/index.html")


if __name__ == "__main__":
    main()
