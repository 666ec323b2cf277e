"""How far outside CB_gt the scales begin at which direct iteration always sees an escape."""

import matplotlib.pyplot as plt
import xarray as xr

cube = xr.open_zarr("direct_boundary/direct_boundary.zarr", chunks=None)
times = cube.escape_time.isel(ensemble=-1, drop=True)  # NaN: inside the last scale without escape
for steps in (cube.n_max // 10, cube.n_max):
    without = cube.excess.where(~(times <= steps)).max("excess")
    bias = 100 * cube.excess.where(~(cube.excess <= without)).min("excess")
    bias.plot(label=f"N = {steps}")
    print(f"N = {steps}: {float(bias.median()):.1f}% outside, in the median")
plt.ylabel("bias of direct iteration (%)")
plt.ylim(0)
plt.legend()
plt.show()
