"""How the diffusion coefficient grows from the boundary of transport, on some rays."""

import matplotlib.pyplot as plt
import xarray as xr

rays = xr.open_zarr("diffusion/diffusion.zarr", chunks=None).diffusion
rays[::5].plot(hue="angle", marker=".", xscale="log", yscale="log")
plt.show()
