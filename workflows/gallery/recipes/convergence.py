"""Distance beyond the breakup at which direct iteration sees transport at the cusp, against N."""

import matplotlib.pyplot as plt
import xarray as xr

cube = xr.open_zarr("convergence/convergence_diagonal.zarr", chunks=None)
plt.loglog(cube.n, cube.distance, ".", label=cube.distance.long_name)
plt.loglog(cube.n, cube.fit, label=cube.fit.long_name)
print(f"η = {cube.eta[0]:.2f} for small N, {cube.eta[1]:.2f} for large N")
plt.xlabel(cube.n.long_name)
plt.legend()
plt.show()
