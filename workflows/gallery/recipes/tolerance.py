"""What a ripple of repeated kicks costs: the loss of scale against the ripple, a power law."""

import matplotlib.pyplot as plt
import xarray as xr

cube = xr.open_zarr("tolerance/tolerance.zarr", chunks=None)
golden = xr.open_zarr("tolerance/tolerance_random.zarr").golden  # the scale of constant kicks
loss = 1 - cube.critical_scale * cube.rms / golden
for period, one in loss.groupby("period"):
    plt.loglog(one.parameter, one, "o", label=f"{period} kicks")
plt.legend(title="ripples, and what they cost")
plt.show()
