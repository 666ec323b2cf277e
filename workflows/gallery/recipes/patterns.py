"""Scales of the breakup for signs, pairs and bursts of kicks, and the lowest of each family."""

import matplotlib.pyplot as plt
import xarray as xr

cube = xr.open_zarr("patterns/patterns.zarr", chunks=None)
for family, scale in cube.critical_scale.groupby("family"):
    plt.loglog(scale.parameter, scale, "o", label=family)
    first = scale[scale.argmin("forcing")]
    print(f"{family}: first {first.forcing.item()}, at {first:.4f}")
plt.legend(title="scale of the breakup, by the parameter")
plt.show()
