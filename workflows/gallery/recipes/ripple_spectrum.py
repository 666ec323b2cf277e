"""The strength at which the last barrier breaks, against the frequency of a ripple."""

import matplotlib.pyplot as plt
import xarray as xr

cube = xr.open_zarr("ripple_spectrum/ripple_spectrum.zarr", chunks=None).load()
for depth in cube.depth.values:
    ripple = cube.sel(depth=depth)
    (line,) = plt.plot(ripple.frequency, ripple.critical_scale, "o", label=f"depth {depth:g}")
    only_upper = ripple.upper.where(ripple.critical_scale.isnull())
    plt.plot(ripple.frequency, only_upper, "v", mfc="none", color=line.get_color())
plt.xlabel("frequency Ω, turns per kick")
plt.ylabel("κ at the last breakup; hollow: an upper bound")
plt.legend()
plt.show()
