"""How exactly the last barrier is known on each ray: its error, and its bracket from both sides."""

import matplotlib.pyplot as plt
import xarray as xr

cube = xr.open_zarr("last_barrier/boundary.zarr", chunks=None)
bracket = (cube.upper - cube.lower) / cube.critical_scale
plt.semilogy(cube.angle, bracket, ".", label="bracket, upper - lower")
plt.semilogy(cube.angle, cube.error / cube.critical_scale, ".", label="estimated error")
print(f"widest bracket {float(bracket.max()):.1e} at {float(bracket.idxmax()):g}°")
plt.xlabel("angle (degrees)")
plt.ylabel("in parts of the scale")
plt.legend()
plt.show()
