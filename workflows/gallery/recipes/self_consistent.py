"""For how many kicks barriers persist in the field of the particles, against the coupling."""

import matplotlib.pyplot as plt
import xarray as xr

cube = xr.open_zarr("self_consistent/self_consistent_barriers.zarr", chunks=None)
lasting = cube.coupling.where(cube.kicks == float("inf"))
print(f"a start survives up to coupling {float(lasting.max()):g}")
for name, marker in (("kicks", "o"), ("kicks_fitted", "x")):  # inf is not drawn
    cube[name].plot.line(marker=marker, ls="", yscale="log", label=cube[name].long_name)
plt.legend()
plt.show()
