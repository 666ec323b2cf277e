"""Computation of a cube's missing tiles on a dask cluster, whatever the tiles contain."""
