"""How many kicks after the breakup the last families of graphs are excluded, on a ramp."""

import matplotlib.pyplot as plt
import xarray as xr

cube = xr.open_zarr("ramp/ramp.zarr", chunks=None)
cube.lost.plot(marker="o", xscale="log", yscale="log")
plt.show()
