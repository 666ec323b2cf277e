"""Do two runs agree? The same plane computed with other settings, or refined and in full.

    python workflows/examples/compare_stores.py OUT OTHER [N]

OUT and OTHER are the directories of two runs with the cube `escape`.
"""

# %% Open both, and see which settings differ.
import sys
from pathlib import Path

import numpy as np
import xarray as xr

if len(sys.argv) < 3 or not all(Path(d, "escape.zarr").is_dir() for d in sys.argv[1:3]):
    missing = [out for out in sys.argv[1:3] if not Path(out, "escape.zarr").is_dir()]
    words = [f"{out} has no cube escape.zarr; workflows.escape_plane makes one" for out in missing]
    print(__doc__, *words, sep="\n", file=sys.stderr)
    sys.exit(2)
one, other = (xr.open_zarr(Path(out) / "escape.zarr", chunks=None) for out in sys.argv[1:3])
own = {"created", "config_hash", "git_commit", "library_versions", "python_version"}
for key in sorted((one.attrs.keys() | other.attrs.keys()) - own):
    if one.attrs.get(key) != other.attrs.get(key):
        print(f"{key}: {one.attrs.get(key)} and {other.attrs.get(key)}")

# %% Bring the other run to the cells of the first, each with the value of the cell around it.
n = int(sys.argv[3]) if len(sys.argv) > 3 else min(one.attrs["n_max"], other.attrs["n_max"])
first, second = (cube.escape_time.isel(ensemble=-1).load() for cube in (one, other))
reach = [float(abs(np.diff(other[name].values[:2])[0])) / 2 for name in ("kappa1", "kappa2")]
second = second.reindex_like(first, method="nearest", tolerance=max(reach) * 1.000001)

# %% Compare the cells that both have computed.
both = first.notnull() & second.notnull()
differ = ((first <= n) != (second <= n)) & both
print(f"{int(both.sum())} cells in both; {int(differ.sum())} of them answer differently at N={n}")
equal = ((first == second) & both).sum() / both.sum()
print(f"{100 * float(equal):.1f}% have the same escape time to the step")
