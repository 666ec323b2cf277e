"""Orbits from the same starts under two strengths, and with the two strengths exchanged."""

import matplotlib.pyplot as plt
import xarray as xr

cube = xr.open_zarr("portraits/portraits.zarr", chunks=None)
figure, panels = plt.subplots(1, 2, sharey=True, figsize=(9, 4), layout="constrained")
for axes, forcing in zip(panels, cube.forcing, strict=True):
    orbits = cube.sel(forcing=forcing)
    axes.plot(orbits.x, orbits.y, ",k")  # dims (step, orbit): one orbit per column
    axes.set_title(f"κ1 = {orbits.kappa1:.3g}, κ2 = {orbits.kappa2:.3g}")
    axes.set(xlabel="x", ylabel="y")
plt.show()
