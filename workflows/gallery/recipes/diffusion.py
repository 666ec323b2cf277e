"""How the diffusion coefficient grows from the boundary of transport, on some rays."""

import matplotlib.pyplot as plt
import xarray as xr

rays = xr.open_zarr("diffusion/diffusion.zarr", chunks=None).diffusion
for angle in rays.angle.values[::5]:
    plt.loglog(rays.excess, rays.sel(angle=angle), ".-", label=f"{angle:g}°")
plt.legend()
plt.xlabel("distance from the breakup, in parts of its scale")
plt.ylabel("D")
plt.show()
