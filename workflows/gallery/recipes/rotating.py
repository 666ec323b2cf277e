"""The last barrier and the onset of transport in mean and amplitude, and a torus on some rays."""

import matplotlib.pyplot as plt
import xarray as xr

for name, style in (("barrier", "k.-"), ("transport", "C1-"), ("tori", "C2x")):
    cube = xr.open_zarr(f"rotating/{name}.zarr", chunks=None)
    cube = cube.isel(vector=0) if "vector" in cube.dims else cube
    plt.plot(cube.kappa_mean, cube.kappa_amplitude, style, label=cube.title)
plt.xlabel("mean strength")
plt.ylabel("amplitude")
plt.gca().set_aspect("equal")
plt.legend(loc="lower center", bbox_to_anchor=(0.5, 1))
plt.show()
