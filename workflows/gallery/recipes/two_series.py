"""The threshold of two series of kicks against the delay between them, and where it is lowest."""

import matplotlib.pyplot as plt
import xarray as xr

cube = xr.open_zarr("two_series/two_series.zarr", chunks=None).load()
for ratio in cube.ratio.values:
    of_ratio = cube.sel(ratio=ratio).dropna("delay", subset=["critical_scale"])
    plt.plot(of_ratio.tau, of_ratio.critical_scale, "o-", label=f"K_α = {ratio:g} K")
    lowest = of_ratio.isel(delay=int(of_ratio.critical_scale.argmin("delay")))
    value = float(lowest.critical_scale)
    print(f"K_α = {ratio:g} K: lowest at τ = {lowest.delay.item()}, K = {value:.5f}")
plt.xlabel("delay τ of the second series, in periods")
plt.ylabel("K at the last breakup")
plt.legend()
plt.show()
