"""The flux through the broken circle grows as a power of the distance, with exponent near 3.01."""

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

flux = xr.open_zarr("flux/flux.zarr", chunks=None).flux
flux.plot.line(x="excess", hue="angle", marker=".", xscale="log", yscale="log")
for angle in flux.angle.values:
    near = flux.sel(angle=angle, excess=slice(0, 0.1)).dropna("excess")
    if near.size > 2:
        slope, _ = np.polyfit(np.log(near.excess), np.log(near), 1)
        print(f"{angle:g}°: exponent {slope:.3f} within 10% of the breakup")
plt.show()
