"""The boundary of transport within N steps as a curve: contour the field, write its points.

    python workflows/examples/contour_boundary.py OUT [N]

OUT is the directory of a run with the cube `escape`. Writes OUT/contour_boundary.csv, with the
columns curve, kappa1, kappa2.
"""

# %% Open, and answer the yes-or-no question in every cell.
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from contourpy import contour_generator
from scipy.ndimage import median_filter

if len(sys.argv) < 2 or not Path(sys.argv[1], "escape.zarr").is_dir():
    missing = [f"{out} has no cube escape.zarr; escape_plane makes one" for out in sys.argv[1:2]]
    print(__doc__, *missing, sep="\n", file=sys.stderr)
    sys.exit(2)
out = Path(sys.argv[1])
cube = xr.open_zarr(out / "escape.zarr")
n = int(sys.argv[2]) if len(sys.argv) > 2 else cube.attrs["n_max"]
largest = cube.escape_time.isel(ensemble=-1).load()
known = largest.notnull()
# Whether one cell escapes is a matter of chance; the running median of 7 × 7 cells hardly is.
largest = largest.copy(data=median_filter(largest.where(known, np.inf).values, 7))
transport = (largest <= n).where(known)  # NaN, not computed, ends a curve

# %% Halfway between cells that say no (0) and cells that say yes (1).
lines = contour_generator(cube.kappa1.values, cube.kappa2.values, transport.values).lines(0.5)
lines = sorted(lines, key=len, reverse=True)
print(f"{len(lines)} curves; the longest has {len(lines[0]) if lines else 0} points")

# %% A table. The boundary is known to the width of a cell, not better.
frames = [
    pd.DataFrame({"curve": i, "kappa1": line[:, 0], "kappa2": line[:, 1]})
    for i, line in enumerate(lines)
]
table = pd.concat(frames) if frames else pd.DataFrame(columns=["curve", "kappa1", "kappa2"])
table.to_csv(out / "contour_boundary.csv", index=False)
widths = [float(np.diff(cube[name].values[:2])[0]) for name in ("kappa1", "kappa2")]
print(f"cells are {widths[0]:.3g} by {widths[1]:.3g}; wrote {out / 'contour_boundary.csv'}")
