"""Where signs, pairs and bursts of kicks let go, with the forcing that lets go first in each."""

import matplotlib.pyplot as plt
import xarray as xr

cube = xr.open_zarr("patterns/patterns.zarr", chunks=None).load()
table = cube.drop_dims(["kick", "quotient"]).to_dataframe()
for family, rows in table.groupby("family"):
    plt.plot(rows.parameter, rows.critical_scale, "o", label=family)
    print(f"{family}: first {rows.critical_scale.idxmin()}, at {rows.critical_scale.min():.4f}")
plt.xlabel("parameter of the family")
plt.ylabel("scale of the breakup")
plt.xscale("log")
plt.legend()
plt.show()
