"""How a cube is computed: its missing tiles, on a dask cluster, whatever they contain."""
