"""The last barrier, the onset of transport, and the breakup of tori, against mean and amplitude."""

import matplotlib.pyplot as plt
import xarray as xr

for name, style in (("barrier", "k.-"), ("transport", "C1-"), ("rotating_tori", "C2--")):
    cube = xr.open_zarr(f"rotating/{name}.zarr", chunks=None)
    cube = cube.isel(frequency=0) if "frequency" in cube.dims else cube
    plt.plot(cube.kappa_mean, cube.kappa_amplitude, style, label=cube.title)
plt.xlabel("mean strength")
plt.ylabel("amplitude")
plt.gca().set_aspect("equal")
plt.legend(loc="lower center", bbox_to_anchor=(0.5, 1))
plt.show()
