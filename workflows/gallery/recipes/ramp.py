"""How many kicks after the breakup the last families of graphs are lost, in a growing forcing."""

import json

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

cube = xr.open_zarr("ramp/ramp.zarr", chunks=None)
for name, lost in zip(json.loads(cube.way.names), cube.lost, strict=True):
    slope, _ = np.polyfit(np.log(lost.rate), np.log(lost), 1)
    plt.loglog(lost.rate, lost, "o", label=f"{name}: slope {slope:.3f}")
plt.xlabel(cube.rate.long_name)
plt.ylabel(cube.lost.long_name)
plt.legend()
plt.show()
