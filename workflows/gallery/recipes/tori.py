"""Between which scales tori of irrational frequency break: certified below, excluded above."""

import matplotlib.pyplot as plt
import xarray as xr

cube = xr.open_zarr("tori/tori.zarr", chunks=None)
for vector in cube.vector.values:
    torus = cube.sel(vector=vector)
    bars = torus.critical_scale - torus.lower, torus.upper - torus.critical_scale
    label = f"ω = {float(torus.omega):.4f}, Ω = {float(torus.frequency):.4f}"
    plt.errorbar(torus.angle, torus.critical_scale, bars, fmt="o", capsize=3, label=label)
plt.xlabel("angle in the plane of mean and amplitude (degrees)")
plt.ylabel("scale of the breakup")
plt.legend()
plt.show()
