"""Join the levels of a refined plane: all that was computed, at any level, as one table or field.

    python workflows/examples/join_levels.py OUT

OUT is the directory of a run with --levels above 1, and so with the cubes `escape_level0`, … and
`escape`. Writes OUT/join_levels.csv: each computed cell once, with its level, centre and first
escape time.
"""

# %% Each level of refinement is a cube. Its tiles are small: read it without dask.
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

if len(sys.argv) < 2 or not Path(sys.argv[1], "escape_level0.zarr").is_dir():
    words = "has no cube escape_level0.zarr; escape_plane --levels 4 makes one"
    print(__doc__, *(f"{out} {words}" for out in sys.argv[1:2]), sep="\n", file=sys.stderr)
    sys.exit(2)
out = Path(sys.argv[1])
count = len(list(out.glob("escape_level*.zarr")))
paths = [out / f"escape_level{number}.zarr" for number in range(count)]
levels = [xr.open_zarr(path, chunks=None).load() for path in paths]
for number, level in enumerate(levels):
    known = level.escape_time.isel(ensemble=-1).notnull()
    print(f"level {number}: {int(known.sum())} of {known.size} cells computed")

# %% Join them in one table. It keeps a coarse cell also where finer ones lie within.
frames = []
for number, level in enumerate(levels):
    cells = level.escape_time.isel(ensemble=-1, drop=True).to_dataframe().dropna().reset_index()
    frames.append(cells.assign(level=number))
table = pd.concat(frames, ignore_index=True)
table.to_csv(out / "join_levels.csv", index=False)

# %% Join them in one field at the finest resolution: each cell has the finest level computed.
joined = levels[0].escape_time.isel(ensemble=-1)
for level in levels[1:]:
    finer = level.escape_time.isel(ensemble=-1)
    joined = finer.fillna(joined.reindex_like(finer, method="nearest"))

# %% The cube `escape` holds just that.
composed = xr.open_zarr(out / "escape.zarr", chunks=None).escape_time.isel(ensemble=-1)
print("equal to the cube escape:", bool(np.array_equal(joined, composed, equal_nan=True)))
