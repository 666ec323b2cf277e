"""How fast each method comes near the breakup: circles and residues against their work."""

import matplotlib.pyplot as plt
import xarray as xr

cube = xr.open_zarr("convergence/convergence.zarr", chunks=None)
names = {"circles_raw": "circles", "cones_raw": "converse KAM", "residue": "Greene's residue"}
for name, label in names.items():
    error = cube[name].isel(angle=0).dropna(cube[name].dims[1])
    work = error[error.dims[0]]
    plt.loglog(work, abs(error), ".-", label=f"{label}, against {work.long_name}")
plt.title(f"one ray, at {float(cube.angle[0]):g}°")
plt.ylabel("error, in parts of the breakup's scale")
plt.legend()
plt.show()
