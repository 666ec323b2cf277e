"""Export a cube to netCDF and CSV, for programs that do not read zarr.

    python workflows/recipes/export.py OUT [GROUP]

Writes GROUP.nc (netCDF 3, read by everything) and GROUP.csv.
"""

# %% Open; the default is the boundary itself.
import json
import sys
from pathlib import Path

import xarray as xr

out = Path(sys.argv[1])
group = sys.argv[2] if len(sys.argv) > 2 else "barrier"
cube = xr.open_zarr(out / "cubes.zarr", group=group, chunks=None)

# %% netCDF attributes are numbers, texts and lists of numbers: write all others as JSON.
cube = cube.drop_vars("cpu_seconds", errors="ignore").load()
for attrs in (cube.attrs, *(variable.attrs for variable in cube.variables.values())):
    for key, value in attrs.items():
        if not isinstance(value, (str, int, float)):
            attrs[key] = json.dumps(value)
cube.to_netcdf(f"{group}.nc", engine="scipy")

# %% One row for each cell; the partial quotients of ω, a row each, are left to netCDF.
table = cube.drop_dims("quotient", errors="ignore").to_dataframe()
table.to_csv(f"{group}.csv")
print(f"{group}.nc, {group}.csv: {len(table)} rows, {', '.join(cube.data_vars)}")

# %% What was written reads back as it was.
with xr.open_dataset(f"{group}.nc", engine="scipy") as back:
    print("read back equal:", all(back[name].equals(cube[name]) for name in cube.data_vars))
