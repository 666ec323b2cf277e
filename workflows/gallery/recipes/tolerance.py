"""What a ripple of repeated kicks costs: the loss of scale against its size, a power law."""

import matplotlib.pyplot as plt
import xarray as xr

from nasm import periodic

cube = xr.open_zarr("tolerance/tolerance.zarr", chunks=None)
golden = periodic.critical_scale("gamma", [1.0]).value  # of constant kicks
loss = 1 - cube.critical_scale * (cube.profile**2).mean("kick") ** 0.5 / golden
for period, one in loss.groupby("period"):
    plt.loglog(one.parameter, one, "o", label=f"{period} kicks")
plt.xlabel("rms of the ripple, over the mean strength")
plt.ylabel("loss of the scale of the breakup")
plt.legend()
plt.show()
