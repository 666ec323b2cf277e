"""A field larger than memory: statistics by blocks, with dask.

    python workflows/examples/large_field.py OUT

OUT is the directory of a run with the cube `escape`.
"""

# %% Chunks of the store are tiles, far too small for dask: read many at a time.
import sys
from pathlib import Path

import numpy as np
import xarray as xr

if len(sys.argv) < 2 or not Path(sys.argv[1], "escape.zarr").is_dir():
    missing = [f"{out} has no cube escape.zarr; escape_plane makes one" for out in sys.argv[1:2]]
    print(__doc__, *missing, sep="\n", file=sys.stderr)
    sys.exit(2)
out = Path(sys.argv[1])
cube = xr.open_zarr(out / "escape.zarr", chunks={"kappa1": 512, "kappa2": 512})
field = cube.escape_time.isel(ensemble=-1)
print(f"{field.nbytes / 1e6:.1f} MB in {field.data.npartitions} blocks")

# %% The part of the plane with transport within N, for many N at once: one pass over the data.
n = np.unique(np.geomspace(1, cube.attrs["n_max"], 9).astype(int))
within = xr.concat([(field <= steps).mean() for steps in n], xr.DataArray(n, dims="n", name="n"))
print(within.compute().to_series())

# %% A coarser picture of it: the earliest escape in blocks of 4 by 4 cells.
coarse = field.coarsen(kappa1=4, kappa2=4, boundary="trim").min().compute()
print(f"coarse field {coarse.shape}, earliest escape {float(coarse.min()):g}")
