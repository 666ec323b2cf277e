"""How well the last barrier is known on each ray: its error, and its bracket from both sides."""

import matplotlib.pyplot as plt
import xarray as xr

cube = xr.open_zarr("last_barrier/boundary.zarr", chunks=None)
parts = xr.Dataset({"bracket": cube.upper - cube.lower, "error": cube.error}) / cube.critical_scale
parts.to_dataarray("of").plot.line(".", x="angle", hue="of", yscale="log")
plt.ylabel("relative to the scale")
print(f"widest bracket {float(parts.bracket.max()):.1e} at {float(parts.bracket.idxmax()):g}°")
plt.show()
