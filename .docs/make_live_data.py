"""Write the data shown on the live page: python .docs/make_live_data.py [--proved OUT]

`boundary.js` contains CB_gt between 0 and 45 degrees, from which the rest of the plane follows by
symmetry; computing it takes half a minute of CPU time. `proved.js` contains the results of
`workflows.proved_map` with the settings below; computing them takes two CPU minutes, or none if OUT
is the folder of a finished run of that command.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import xarray as xr

from pipeline.cubes.barrier import boundary
from workflows.figures.style import has_flag

TOL = 1e-4
CUSP = 45 - np.geomspace(0.03, 3, 13)[::-1]  # more rays close to the cusp
PROVED = "--cells", "128", "--distance", "0.2"
DIGITS = 7  # digits of the corners of triangles, which are rounded towards zero


def boundary_data() -> dict[str, object]:
    """Return the rays' angles and, for each ray, the last circle, its breakup and the bracket."""
    angles = sorted({*np.linspace(0, 45, 46), *CUSP.round(4)})
    cube = boundary(angles, TOL)
    names = {"value": "critical_scale", "lower": "lower", "upper": "upper"}
    data = {"angle": cube.angle.values.tolist(), "circle": cube.circle.values.tolist()}
    return data | {key: cube[name].values.round(9).tolist() for key, name in names.items()}


def proved_data(out: Path) -> dict[str, object]:
    """Return the triangles in which a barrier is proved, and the cells with proved transport.

    A triangle is given by (κ1, κ2) at its two corners other than 0. Cells have width 1/n; a run
    [row, from, to] consists of the cells in that row whose index i along κ1 satisfies
    from ≤ i < to. Triangles and cells cover only 0 ≤ κ2 ≤ κ1.
    """
    names = "proved_map", "proved_triangles"
    cells, triangles = (xr.open_zarr(out / f"{name}.zarr", chunks=None).load() for name in names)
    corners = [f"kappa{i}_{end}" for end in ("low", "high") for i in (1, 2)]
    # A triangle that shrinks towards its corner 0 stays inside the original one; rounding alone
    # could move its corners outside.
    part = triangles.proved_below * (1 - 10.0**-DIGITS)
    shown = np.stack([(part * triangles[name]).values for name in corners], -1)
    is_proved = np.triu(has_flag(cells.proved, "transport_is_global"))
    steps = np.diff(is_proved.astype(int), axis=1, prepend=0, append=0)
    (rows, first), (_, end) = np.nonzero(steps == 1), np.nonzero(steps == -1)
    runs = np.stack([rows, first, end], -1)
    n = round(1 / float(cells.kappa1[1] - cells.kappa1[0]))
    return {"triangles": shown.round(DIGITS + 2).tolist(), "n": n, "runs": runs.tolist()}


def write(name: str, data: dict[str, object]) -> None:
    """Write data to one of the page's scripts, as a JavaScript constant."""
    text = json.dumps(data, ensure_ascii=False, separators=(",", ":"))
    path = Path(__file__).with_name("live") / f"{name}.js"
    line = f"// Made by make_live_data.py.\nconst {name.upper()} = {text};\n"
    path.write_text(line, encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--proved", type=Path, help="folder of a run of workflows.proved_map")
    options = parser.parse_args()
    if options.proved:
        write("proved", proved_data(options.proved))
        return
    write("boundary", boundary_data())
    with TemporaryDirectory() as out:
        command = [sys.executable, "-m", "workflows.proved_map", *PROVED, "--quiet", "--out", out]
        subprocess.run(command, check=True)
        write("proved", proved_data(Path(out)))


if __name__ == "__main__":
    main()
