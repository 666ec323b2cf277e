"""The diffusion coefficient over the plane, and how it grows from the boundary of transport."""

import matplotlib.pyplot as plt
import xarray as xr
from matplotlib.colors import LogNorm

plane = xr.open_zarr("diffusion/diffusion.zarr", chunks=None).diffusion
rays = xr.open_zarr("diffusion/diffusion_rays.zarr", chunks=None).diffusion
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
plane.where(plane > 0).plot(ax=left, norm=LogNorm())  # 0: a barrier exists
for angle in rays.angle.values:
    right.loglog(rays.excess, rays.sel(angle=angle), ".-", label=f"{angle:g}°")
right.set(xlabel="distance from the breakup, in parts of its scale", ylabel="D")
right.legend(ncols=2, fontsize="small")
plt.show()
