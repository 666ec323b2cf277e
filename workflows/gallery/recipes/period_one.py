"""How many of the four primary period-one orbits are stable, by Greene's residue."""

import matplotlib.pyplot as plt
import xarray as xr

residue = xr.open_zarr("period_one/period_one_primary.zarr", chunks=None).residue
stable = ((residue > 0) & (residue < 1)).sum("point")
stable.assign_attrs(long_name="stable primary points").plot(levels=[0, 1, 2, 3, 4])
print(f"all four are unstable in {float((stable == 0).mean()):.0%} of this plane")
plt.gca().set_aspect("equal")
plt.show()
