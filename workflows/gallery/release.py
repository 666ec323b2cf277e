"""The deposit of all results under a DOI: data sets, their commands, and checksums.

The deposit is a directory. It contains a folder for each exhibit, with its cubes, tables, figures
and certificates, and five files: README.md, LICENSE, SHA256SUMS, the program
certificate_checker.py, and .zenodo.json, the metadata that the repository Zenodo reads. The proved
map computed with `--full` is a separate deposit.
"""

import hashlib
import json
from importlib import metadata
from pathlib import Path

from nasm import proofs
from workflows.figures import files
from workflows.gallery.exhibits import command_of, listed, run

RELEASE = listed("release.toml")
FULL_MAP = listed("release_full_map.toml")
SUMS = "SHA256SUMS"
CHECKER = Path(proofs.__file__).with_name("certificate_checker.py")
TITLE = "Where the last barrier of the nonautonomous standard map breaks"


def make_release(directory, exhibits, workers, quick, quiet):
    """Make or resume the deposit of exhibits in a directory; return its size in bytes."""
    for exhibit in exhibits:
        run(exhibit, directory, workers, quick, quiet)
    folder = Path(directory)
    files.write(folder / "README.md", _readme(folder, exhibits, quick))
    files.write(folder / "LICENSE", _license())
    files.write(folder / CHECKER.name, CHECKER.read_text(encoding="utf-8"))
    files.write(folder / ".zenodo.json", json.dumps(_zenodo(exhibits), indent=1) + "\n")
    paths = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    paths = [path for path in paths if path.name not in (SUMS, ".lock")]
    paths = [path for path in paths if path.suffix != files.BESIDE]  # left over from killed runs
    digests = {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}
    sums = (f"{sum}  {path.relative_to(folder).as_posix()}\n" for path, sum in digests.items())
    files.write(folder / SUMS, "".join(sums))
    return sum(path.stat().st_size for path in paths)


def _license():
    """Return the licence of the program, which is also that of its results."""
    package = metadata.distribution("nasm-transport")
    (path,) = (path for path in package.files if path.name == "LICENSE")
    return path.read_text(encoding="utf-8")


def _zenodo(exhibits):
    """Return the metadata of the deposit.

    Before publication, the owner should enter the names of the creators.
    """
    about = metadata.metadata("nasm-transport")
    contents = "".join(f"<li>{exhibit.title}</li>" for exhibit in exhibits)
    description = (
        "<p>Results of a program for the nonautonomous standard map, y' = y + κ_n/(2π) sin(2πx), "
        f"x' = x + y' mod 1, κ_n periodic in n.</p><ul>{contents}</ul>"
        "<p>README.md contains the commands that computed these results.</p>"
    )
    paper = {"identifier": "arXiv:1606.04824", "relation": "references", "scheme": "arxiv"}
    return {
        "title": f"{TITLE}: data",
        "upload_type": "dataset",
        "description": description,
        "creators": [{"name": about["Author"]}],
        "license": about["License-Expression"],
        "access_right": "open",
        "version": about["Version"],
        "keywords": about["Keywords"].split(","),
        "related_identifiers": [paper],
    }


def _readme(folder, exhibits, quick):
    import xarray as xr

    from nasm import __version__

    parts = ""
    for exhibit in exhibits:
        parts += f"## {exhibit.name}\n\n{exhibit.title}.\n\n    {command_of(exhibit, quick)}\n\n"
        for path in sorted((folder / exhibit.name).glob("*.zarr")):
            computed_by = xr.open_zarr(path, chunks=None).attrs["computed_by"]
            parts += f"`{path.name}`: {computed_by}.\n\n"
    return f"""# {TITLE}

Results for the map of arXiv:1606.04824, computed by nasm {__version__}. Each cube, a folder
NAME.zarr, is opened by `xarray.open_zarr(path)`; its attributes describe its numbers and how they
were computed. The tables (CSV) contain the same numbers. LICENSE applies to all files.

{parts}`sha256sum -c {SUMS}` checks all files. With nasm installed, `python -m workflows.verify
--out .` checks all cubes; with `--proofs`, it also checks the certificates. Without nasm,
`python {CHECKER.name} proved_map/certificates/proved_map/TILE.json.xz` checks the certificates of a
tile; this program needs only python-flint.
"""
