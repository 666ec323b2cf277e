"""What a DOI holds: the last barrier, the six circles of the paper, and the proved map.

Each as its command leaves it, with the certificates; besides, a README that says by which command
and which versions, and the checksums of all files, SHA256SUMS.
"""

import hashlib
from pathlib import Path

from workflows.gallery.exhibits import command_of, listed, run

EXHIBITS = listed("release.toml")
SUMS = "SHA256SUMS"


def make(directory, workers, quick):
    """Make or resume the release in a directory; return its size in bytes."""
    for exhibit in EXHIBITS:
        run(exhibit, directory, workers, quick)
    here = Path(directory)
    (here / "README.md").write_text(_readme(quick), encoding="utf-8")
    files = [path for path in sorted(here.rglob("*")) if path.is_file()]
    files = [path for path in files if path.name not in (SUMS, ".lock")]
    digests = {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    sums = (f"{sum}  {path.relative_to(here).as_posix()}\n" for path, sum in digests.items())
    (here / SUMS).write_text("".join(sums), encoding="utf-8")
    return sum(path.stat().st_size for path in files)


def _readme(quick):
    from nasm import __version__
    from pipeline.store import COMPUTED_BY

    parts = "".join(
        f"## {exhibit.name}\n\n{exhibit.title}.\n\n    {command_of(exhibit, quick)}\n\n"
        for exhibit in EXHIBITS
    )
    return f"""# Where the last barrier of the nonautonomous standard map breaks

The map of arXiv:1606.04824, computed by nasm {__version__} ({COMPUTED_BY}). Each cube, a folder
NAME.zarr, is opened by `xarray.open_zarr(path)`; its attributes say what its numbers are and who
computed them. The tables (CSV) hold the same.

{parts}`sha256sum -c {SUMS}` checks all files; in a copy of the program, `python -m workflows.verify
--out FOLDER` checks the cubes of a folder, and `--proofs` the certificates as well.
"""
