"""Exhibits: commands, their titles, and their options for a preview and for the full size.

A release, the data set for a DOI, consists of the last barrier, the six circles of the paper, and
the proved map. It contains the output of these commands with the certificates, a README with the
commands and versions, and the checksums of all files, SHA256SUMS.
"""

import hashlib
import shlex
import tomllib
from dataclasses import dataclass
from pathlib import Path

import click

from workflows.figures import files
from workflows.shared.cli import main_of


@dataclass(frozen=True)
class Exhibit:
    """A command, its title, and its options for a preview and for the size of the paper.

    beyond : True if it answers a question that the paper does not ask.
    """

    name: str
    title: str
    quick: str = ""
    full: str = ""
    beyond: bool = False

    def options(self, quick):
        """Return the options of the command line as a list."""
        return shlex.split(self.quick if quick else self.full)


def listed(file):
    """Return the Exhibits listed in a TOML file in this folder."""
    texts = tomllib.loads(Path(__file__).with_name(file).read_text(encoding="utf-8"))
    beyond = texts.pop("beyond", {})
    own = [Exhibit(name, **about) for name, about in texts.items()]
    return own + [Exhibit(name, **about, beyond=True) for name, about in beyond.items()]


def run(exhibit, out, workers, quick, quiet):
    """Run the command of an exhibit, which writes to the folder OUT/NAME."""
    main = main_of(exhibit.name)
    swept = any(option.name == "scheduler" for option in main.params)
    options = [*exhibit.options(quick), "--out", f"{out}/{exhibit.name}"]
    options += ["--quiet"] * quiet + [*workers] * swept
    if not quiet:
        click.echo(f": {exhibit.title}", err=True)
    main.main(options, standalone_mode=False)


def command_of(exhibit, quick):
    """Return the command line of an exhibit, which writes to the folder named after it."""
    start = ["python", "-m", f"workflows.{exhibit.name}"]
    return shlex.join([*start, *exhibit.options(quick), "--out", exhibit.name])


RELEASE = listed("release.toml")
SUMS = "SHA256SUMS"


def make_release(directory, workers, quick, quiet):
    """Make or resume the release in a directory; return its size in bytes."""
    for exhibit in RELEASE:
        run(exhibit, directory, workers, quick, quiet)
    folder = Path(directory)
    files.write(folder / "README.md", _readme(folder, quick))
    paths = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    paths = [path for path in paths if path.name not in (SUMS, ".lock")]
    paths = [path for path in paths if path.suffix != files.BESIDE]  # left by a run that was killed
    digests = {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}
    sums = (f"{sum}  {path.relative_to(folder).as_posix()}\n" for path, sum in digests.items())
    files.write(folder / SUMS, "".join(sums))
    return sum(path.stat().st_size for path in paths)


def _readme(folder, quick):
    import xarray as xr

    from nasm import __version__

    parts = ""
    for exhibit in RELEASE:
        parts += f"## {exhibit.name}\n\n{exhibit.title}.\n\n    {command_of(exhibit, quick)}\n\n"
        for path in sorted((folder / exhibit.name).glob("*.zarr")):
            computed_by = xr.open_zarr(path, chunks=None).attrs["computed_by"]
            parts += f"`{path.name}`: {computed_by}.\n\n"
    return f"""# Where the last barrier of the nonautonomous standard map breaks

The map of arXiv:1606.04824, computed by nasm {__version__}. Each cube, a folder NAME.zarr, is
opened by `xarray.open_zarr(path)`; its attributes describe its numbers and how they were computed.
The tables (CSV) contain the same numbers.

{parts}`sha256sum -c {SUMS}` checks all files. With nasm installed, `python -m workflows.verify
--out FOLDER` checks the cubes of a folder, and `--proofs` the certificates as well.
"""
