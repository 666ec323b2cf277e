"""The last barrier against the frequency of the forcing, for all phases."""

import matplotlib.pyplot as plt
import xarray as xr

cube = xr.open_zarr("frequencies/frequencies.zarr", chunks=None).isel(angle=0).load()
cube.plot.scatter(x="frequency", y="critical_scale", hue="phase", s=12)  # irrational Ω: grey
irrational = cube.where(cube.phase.isnull(), drop=True)
plt.plot(irrational.frequency, irrational.critical_scale, "s", color="0.5", label="irrational Ω")
plt.title(f"on the ray at {float(cube.angle):g}°")
plt.legend()
plt.show()
