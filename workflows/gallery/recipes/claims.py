"""Counts of the verdicts on the paper's claims."""

import matplotlib.pyplot as plt
import pandas as pd
import xarray as xr

table = pd.read_csv("claims/claims.csv")
print(table[table.verdict != "holds"][["place", "statement", "value"]].to_string())
table.verdict.value_counts().plot.barh(title=f"{len(table)} claims")
barrier = xr.open_zarr("claims/barrier.zarr", chunks=None)
print("cusp of CB_gt at", barrier.critical_scale.sel(angle=45).item() / 2**0.5)
plt.show()
