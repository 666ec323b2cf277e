"""Join the levels of a refined plane: all that was computed, at any level, as one table or field.

    python workflows/recipes/join_levels.py OUT

OUT is the directory of a run with --levels above 1, and so with the groups `escape_level0`, … and
`escape`. Writes OUT/join_levels.csv: each computed cell once, with its level, centre and first
escape time.
"""

# %% The whole store is a tree of groups; each level of refinement is one.
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

if len(sys.argv) < 2 or not Path(sys.argv[1], "cubes.zarr/escape_level0").is_dir():
    print(__doc__, file=sys.stderr)
    sys.exit(2)
out = Path(sys.argv[1])
tree = xr.open_datatree(out / "cubes.zarr", engine="zarr")
names = sorted((name for name in tree if name.startswith("escape_level")), key=len)
levels = [tree[name].to_dataset() for name in names]
for name, level in zip(names, levels, strict=True):
    known = level.escape_time.isel(ensemble=-1).notnull()
    print(f"{name}: {int(known.sum())} of {known.size} cells computed")

# %% One table of all of them. A coarse cell stays in it where finer ones lie within.
frames = []
for number, level in enumerate(levels):
    cells = level.escape_time.isel(ensemble=-1, drop=True).to_dataframe().dropna().reset_index()
    frames.append(cells.assign(level=number))
table = pd.concat(frames, ignore_index=True)
table.to_csv(out / "join_levels.csv", index=False)

# %% One field at the finest resolution: the finest level that was computed in each cell wins.
joined = levels[0].escape_time.isel(ensemble=-1)
for level in levels[1:]:
    finer = level.escape_time.isel(ensemble=-1)
    joined = finer.fillna(joined.reindex_like(finer, method="nearest"))

# %% The cube `escape` holds just that.
composed = tree["escape"].escape_time.isel(ensemble=-1)
print("equal to the cube escape:", bool(np.array_equal(joined, composed, equal_nan=True)))
