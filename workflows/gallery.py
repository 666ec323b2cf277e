"""The paper, regenerated: every figure with its caption, its command and its numbers, on one page.

Runs one command after the other (arXiv:1606.04824, Figs. 1 to 11, and what goes beyond them), each
into a directory of its own in OUT, all on the same workers, and writes OUT/index.html. Each of them
resumes by itself.
"""

import csv
import shlex
from collections import Counter
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import click

from workflows.parts.cli import cluster_options, command, main_of, out_option


@dataclass(frozen=True)
class Exhibit:
    """A command, what it shows, and its options for a preview and for the paper's size."""

    title: str
    name: str
    quick: str = ""
    full: str = ""


EXHIBITS = (
    Exhibit(
        "Where global transport begins, and what breaks there",
        "critical_boundary",
        "--kappa1 -1.1:1.1:128 --kappa2 0:1.1:64 --levels 3 --n-max 5000 --angles 61 --tol 1e-3",
    ),
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


# Verdicts of the claims' table, and what the page's style calls them.
_KINDS = {
    "holds": "holds",
    "holds with a caveat": "caveat",
    "does not hold": "fails",
    "not decided": "undecided",
}


def run(exhibit, out, workers, quick):
    """Run the command with its cubes, tables and figures in a directory of OUT."""
    main = main_of(exhibit.name)
    swept = any(option.name == "scheduler" for option in main.params)
    options = [*_options(exhibit, quick), "--out", f"{out}/{exhibit.name}"]
    click.echo(f": {exhibit.title}", err=True)
    main.main([*options, *(workers if swept else [])], standalone_mode=False)


def shown(exhibit, out, quick):
    """Return what the page shows of the results of a command."""
    here, name = Path(out, exhibit.name), exhibit.name
    texts = {path.stem: path.read_text(encoding="utf-8").strip() for path in here.glob("*.txt")}
    files = sorted(path for kind in ("pdf", "csv", "html") for path in here.glob(f"*.{kind}"))
    pictures = sorted(here.glob("*.png"))
    return {
        "title": exhibit.title,
        "name": name,
        "command": shlex.join(
            ["python", "-m", f"workflows.{name}", *_options(exhibit, quick), "--out", name]
        ),
        "pictures": [(f"{name}/{path.name}", texts.get(path.stem, "")) for path in pictures],
        "files": [f"{name}/{path.name}" for path in files],
        "cubes": [f"{name}/{path.name}" for path in sorted(here.glob("*.zarr"))],
    }


def judged(out):
    """Return the claims, as rows of their table, and how many have which verdict."""
    path = Path(out, "claims", "claims.csv")
    if not path.exists():
        return [], []
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    counts = Counter(row["verdict"] for row in rows)
    plural = {kind: kind.replace("holds", "hold").replace("does", "do") for kind in _KINDS}
    told = [(counts[kind], plural[kind]) for kind in _KINDS if counts[kind]]
    return [{**row, "kind": _KINDS[row["verdict"]]} for row in rows], told


def _options(exhibit, quick):
    return (exhibit.quick if quick else exhibit.full).split()


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
    from nasm import __version__
    from workflows.parts.page import render
    from workflows.parts.run import shared_workers

    Path(out).mkdir(parents=True, exist_ok=True)
    wanted = [exhibit for exhibit in EXHIBITS if not only or exhibit.name in only]
    with shared_workers(scheduler, workers, tls) as workers:
        for number, exhibit in enumerate(wanted, 1):
            click.echo(f"\nexhibit {number} of {len(wanted)}", err=True, nl=False)
            run(exhibit, out, workers, quick)
            # After each of them, so that there is something to see.
            there = [exhibit for exhibit in EXHIBITS if Path(out, exhibit.name).exists()]
            claims, counts = judged(out)
            render(
                "parts/gallery.html",
                f"{out}/index.html",
                sections=[shown(exhibit, out, quick) for exhibit in there],
                claims=claims,
                counts=counts,
                quick=quick,
                made=f"{date.today():%d %B %Y}, nasm {__version__}",
            )
    told = ", ".join(f"{number} {words}" for number, words in counts)
    n_figures = sum(1 for _ in Path(out).glob("*/*.png"))
    claimed = f" The claims of the paper: {told}." if told else ""
    click.echo(f"\n{n_figures} figures of {len(there)} commands on one page.{claimed}")
    click.echo(f"page: {out}/index.html")


if __name__ == "__main__":
    main()
