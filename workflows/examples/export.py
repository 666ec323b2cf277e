"""Export a cube to netCDF and CSV, for programs that do not read zarr.

    python workflows/examples/export.py OUT [CUBE]

OUT is the directory of a run with that cube; by default it is `barrier`, the boundary itself.
Writes OUT/CUBE.nc (netCDF 3, read by everything) and OUT/CUBE.csv.
"""

# %% Open.
import sys
from pathlib import Path

import xarray as xr

out, name = Path(*sys.argv[1:2]), (sys.argv[2:] or ["barrier"])[0]
if not (out / f"{name}.zarr").is_dir():
    there = sorted(path.stem for path in out.glob("*.zarr"))
    sys.exit(f"{__doc__}\n{out} has no cube {name}.zarr, but {there}")
cube = xr.open_zarr(out / f"{name}.zarr", chunks=None).load()

# %% netCDF.
cube.to_netcdf(out / f"{name}.nc", engine="scipy")

# %% One row for each cell; partial quotients of ω and bounds of cells are left to netCDF.
table = cube.drop_dims(["quotient", "bound"], errors="ignore").to_dataframe()
for key in table:
    if words := cube[key].attrs.get("flag_meanings", "").split():
        table[key] = table[key].map(dict(zip(cube[key].flag_values, words, strict=True)))
table.to_csv(out / f"{name}.csv")
print(f"{out}/{name}.nc, {out}/{name}.csv: {len(table)} rows, {', '.join(cube.data_vars)}")

# %% What was written reads back as it was.
with xr.open_dataset(out / f"{name}.nc", engine="scipy") as back:
    print("read back equal:", all(back[key].equals(cube[key]) for key in cube.data_vars))
