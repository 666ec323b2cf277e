"""Planes of unequal grids or settings: where their answers differ, and all of them as one field.

    python workflows/examples/planes.py OUT OTHER... [N]

OUT, OTHER, ... are directories of runs with the cube `escape`: the same plane with other settings,
or a wide and coarse plane, and narrow and fine ones. Writes OUT/planes.png, the transport within N
steps: in each place the answer of the finest plane that has one.
"""

# %% Open all, the finest first, and see which settings differ.
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

*directories, last = map(Path, sys.argv[1:] or [""])
n = int(str(last)) if str(last).isdigit() else None
directories += [last] if n is None else []
missing = [out for out in directories if not (out / "escape.zarr").is_dir()]
if len(directories) < 2 or missing:
    sys.exit("\n".join([__doc__, *(f"{out} has no cube escape.zarr" for out in missing)]))


def width(cube, name):
    return float(np.diff(cube[f"{name}_bounds"][0])[0])


cubes = [xr.open_zarr(out / "escape.zarr", chunks=None) for out in directories]
own = {"created", "config_hash", "crc32"}
for key in sorted(set().union(*(cube.attrs for cube in cubes)) - own):
    values = [str(cube.attrs.get(key)) for cube in cubes]
    if len(set(values)) > 1:
        print(f"{key}: {' and '.join(values)}")
cubes.sort(key=lambda cube: width(cube, "kappa1"))
n = n or min(cube.attrs["n_max"] for cube in cubes)

# %% A grid over all of them, as fine as the finest, and each plane's answer in its cells. Bounds
# say where a plane ends: beyond half a cell from the last centre it has no answer.
grid = {}
for name in ("kappa1", "kappa2"):
    ends = [cube[f"{name}_bounds"].values for cube in cubes]
    lo, hi, step = min(e.min() for e in ends), max(e.max() for e in ends), width(cubes[0], name)
    grid[name] = lo + step * (np.arange(round((hi - lo) / step)) + 0.5)
joined = None
for cube in cubes:
    field = cube.escape_time.isel(ensemble=-1, drop=True).load()
    answer = (field <= n).where(field.notnull())
    for name, centres in grid.items():
        reach = width(cube, name) / 2 * 1.000001
        answer = answer.reindex({name: centres}, method="nearest", tolerance=reach)
    if joined is not None:
        both = joined.notnull() & answer.notnull()
        differ = int(((joined != answer) & both).sum())
        print(f"{int(both.sum())} cells in both; {differ} of them answer differently at N={n}")
    joined = answer if joined is None else joined.combine_first(answer)
print(f"{joined.sizes['kappa1']} by {joined.sizes['kappa2']} cells, {float(joined.mean()):.6f}")

# %% Draw it.
figure, axes = plt.subplots(figsize=(9, 5), layout="constrained")
joined.plot(ax=axes, vmin=0, vmax=1, add_colorbar=False)
axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", title=f"transport within {n} steps")
axes.set_aspect("equal")
figure.savefig(directories[0] / "planes.png")
print(f"wrote {directories[0] / 'planes.png'}")
