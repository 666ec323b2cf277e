"""Where barriers of three kicks outlast those of two: scales of the breakup on rays, by phase."""

from pathlib import Path

import matplotlib.pyplot as plt
import xarray as xr

for path in sorted(Path("three_kicks").glob("barrier*.zarr")):
    cube = xr.open_zarr(path, chunks=None)  # the fundamental domain; symmetries give the other rays
    label = path.stem.removeprefix("barrier_") if "_" in path.stem else "two kicks"
    cube.critical_scale.plot.line(marker=".", label=label)
plt.legend(title="frequency and phase")
plt.show()
