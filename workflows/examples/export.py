"""Export a cube to netCDF and CSV, for programs that do not read zarr.

    python workflows/examples/export.py OUT [CUBE]

OUT is the directory of a run with that cube; by default it is `barrier`, the boundary itself.
Writes OUT/CUBE.nc (netCDF 3, read by everything) and OUT/CUBE.csv.
"""

# %% Open.
import sys
from pathlib import Path

import xarray as xr

name = sys.argv[2] if len(sys.argv) > 2 else "barrier"
if len(sys.argv) < 2 or not Path(sys.argv[1], f"{name}.zarr").is_dir():
    there = sorted(path.stem for out in sys.argv[1:2] for path in Path(out).glob("*.zarr"))
    missing = [f"{out} has no cube {name}.zarr, but {there}" for out in sys.argv[1:2]]
    print(__doc__, *missing, sep="\n", file=sys.stderr)
    sys.exit(2)
out = Path(sys.argv[1])
cube = xr.open_zarr(out / f"{name}.zarr", chunks=None).load()

# %% netCDF.
outcomes = {
    key: dict(zip(codes.flag_values, codes.flag_meanings.split(), strict=True))
    for key, codes in cube.data_vars.items()
    if "flag_meanings" in codes.attrs
}
cube.to_netcdf(out / f"{name}.nc", engine="scipy")

# %% One row for each cell; partial quotients of ω and bounds of cells are left to netCDF.
table = cube.drop_dims(["quotient", "bound"], errors="ignore").to_dataframe()
for key, words in outcomes.items():
    table[key] = table[key].map(words)
table.to_csv(out / f"{name}.csv")
print(f"{out}/{name}.nc, {out}/{name}.csv: {len(table)} rows, {', '.join(cube.data_vars)}")

# %% What was written reads back as it was.
with xr.open_dataset(out / f"{name}.nc", engine="scipy") as back:
    print("read back equal:", all(back[key].equals(cube[key]) for key in cube.data_vars))
