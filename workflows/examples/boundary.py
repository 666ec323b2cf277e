"""CB_gt itself: plot it, group it by the last circle, and take it to other coordinates.

    python workflows/examples/boundary.py OUT

OUT is the directory of a run with the cube `boundary`, by last_barrier or critical_boundary. Writes
OUT/boundary.png and OUT/last_circles.csv.
"""

# %% Open. From Python it comes without a run: pipeline.cubes.barrier.boundary(angles, tol).
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

if len(sys.argv) < 2 or not Path(sys.argv[1], "boundary.zarr").is_dir():
    missing = [f"{out} has no cube boundary.zarr" for out in sys.argv[1:2]]
    print(__doc__, *missing, sep="\n", file=sys.stderr)
    sys.exit(2)
out = Path(sys.argv[1])
boundary = xr.open_zarr(out / "boundary.zarr").load()
print(boundary)

# %% One ray, and the rays of one circle.
print(boundary.sel(angle=45, method="nearest").critical_scale.item())
golden = boundary.where(boundary.circle == "[0;(1)]", drop=True)
print(f"the circle of the golden mean is the last on {golden.angle.size} rays")

# %% Group by the last circle: how many rays are its own, and how far out it breaks.
table = boundary.to_dataframe()
circles = table[table.circle != ""].groupby("circle").critical_scale.agg(["size", "min", "max"])
circles.sort_values("size", ascending=False).to_csv(out / "last_circles.csv")
print(circles.sort_values("size", ascending=False).head())

# %% Other coordinates: mean and amplitude of the two strengths, as for rotating maps.
mean = (boundary.kappa1 + boundary.kappa2) / 2
amplitude = (boundary.kappa1 - boundary.kappa2) / 2
boundary = boundary.assign(kappa_mean=mean, kappa_amplitude=amplitude)

# %% A picture in each, coloured by ω. CB_gt is symmetric in the origin: (κ1, κ2) → -(κ1, κ2).
figure, panels = plt.subplots(1, 2, figsize=(10, 3), layout="constrained")
labels = r"$\kappa_1$", r"$\kappa_2$", r"$\bar\kappa$", r"$\Delta\kappa$"
pairs = ("kappa1", "kappa2"), ("kappa_mean", "kappa_amplitude")
for panel, (x, y), (right, up) in zip(panels, pairs, np.reshape(labels, (2, 2)), strict=True):
    points = panel.scatter(boundary[x], boundary[y], c=boundary.omega, s=6)
    panel.set(xlabel=right, ylabel=up, aspect="equal")
figure.colorbar(points, ax=panels, label=r"$\omega$ of the last circle")
figure.savefig(out / "boundary.png")
print(f"wrote {out / 'boundary.png'} and {out / 'last_circles.csv'}")
