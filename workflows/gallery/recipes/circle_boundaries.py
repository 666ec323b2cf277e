"""The boundaries CB_ω of single circles, by Greene's residue, under CB_gt, which is their hull."""

import matplotlib.pyplot as plt
import xarray as xr

cube = xr.open_zarr("circle_boundaries/breakdown_residue.zarr", chunks=None)
for omega in cube.circle.values:
    one = cube.sel(circle=omega)
    plt.plot(one.kappa1, one.kappa2, label=f"ω = {omega}")
    print(f"ω = {omega} breaks last at angle {float(one.critical_scale.idxmax()):g}°")
plt.xlabel(cube.kappa1.long_name)
plt.ylabel(cube.kappa2.long_name)
plt.gca().set_aspect("equal")
plt.legend()
plt.show()
