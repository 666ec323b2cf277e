"""Open a cube and select the number of steps: transport within N, for any N up to n_max.

    python workflows/recipes/select_steps.py OUT [N]

OUT is the directory of a run with the cube `escape`. Writes OUT/select_steps.png.

Cells (# %%) open as a notebook in Jupyter (with jupytext), VS Code and Spyder.
"""

# %% Open. Nothing is read until it is needed.
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import xarray as xr
from matplotlib.colors import LogNorm

if len(sys.argv) < 2 or not Path(sys.argv[1], "escape.zarr").is_dir():
    missing = [
        f"{out} has no cube escape.zarr; workflows.escape_plane makes one" for out in sys.argv[1:2]
    ]
    print(__doc__, *missing, sep="\n", file=sys.stderr)
    sys.exit(2)
out = Path(sys.argv[1])
cube = xr.open_zarr(out / "escape.zarr")
print(cube)

# %% The first escape time holds the answer for every N: transport if it is at most N.
n = int(sys.argv[2]) if len(sys.argv) > 2 else cube.attrs["n_max"]
largest = cube.escape_time.isel(ensemble=-1)
transport = largest <= n
computed = largest.notnull()  # NaN is "not computed"; inf is "no escape up to n_max"
print(f"transport within {n} steps in {100 * float(transport.where(computed).mean()):.1f}% of the")
print(f"cells computed, which are {100 * float(computed.mean()):.1f}% of the plane")

# %% One cell by its strengths: the nearest centre.
cell = largest.sel(kappa1=0.3, kappa2=0.2, method="nearest")
print(f"at ({float(cell.kappa1):.4f}, {float(cell.kappa2):.4f}): escape at n* = {float(cell)}")

# %% How the answer depends on the size of the ensemble.
for size in cube.ensemble.values:
    mask = cube.escape_time.sel(ensemble=size) <= n
    print(f"{size:8d} orbits: transport in {int(mask.sum())} cells")

# %% A picture.
figure, axes = plt.subplots(figsize=(9, 5), layout="constrained")
axes.set_aspect("equal")
finite = largest.where(transport)
bar = {"label": "first escape (steps)", "location": "bottom", "shrink": 0.6}
finite.plot(ax=axes, norm=LogNorm(vmax=n), cbar_kwargs=bar)
axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", title=f"$N = {n}$")
figure.savefig(out / "select_steps.png")
print(f"wrote {out / 'select_steps.png'}")
