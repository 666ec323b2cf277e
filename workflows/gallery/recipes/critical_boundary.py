"""CB_gt coloured by the circles that break last, drawn over first escape times."""

import matplotlib.pyplot as plt
import xarray as xr
from matplotlib.colors import LogNorm

cube = xr.open_zarr("critical_boundary/escape.zarr", chunks=None)
times = cube.escape_time.isel(ensemble=-1)  # inf: no escape within n_max
boundary = xr.open_zarr("critical_boundary/boundary.zarr", chunks=None)
times.where(times < float("inf")).plot(norm=LogNorm(1, cube.n_max), aspect=2, size=4)
plt.scatter(boundary.kappa1, boundary.kappa2, c=boundary.omega, s=9, cmap="twilight")
plt.title(f"CB_gt on {boundary.angle.size} rays")
print(boundary.to_dataframe().circle.value_counts())
plt.show()
