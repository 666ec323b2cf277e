"""The boundaries CB_ω of single circles, by Greene's residue; CB_gt is their envelope."""

import matplotlib.pyplot as plt
import xarray as xr

cube = xr.open_zarr("circle_boundaries/breakdown_residue.zarr", chunks=None).load()
cube.plot.scatter(x="kappa1", y="kappa2", hue="circle", s=9)
print("angle at which each circle breaks last:", cube.critical_scale.idxmax("angle").to_series())
plt.gca().set_aspect("equal")
plt.show()
