"""How a cube is computed: the missing tiles of it, on a dask cluster, whatever is in them.

`sweep` is the loop; `cluster` finds the workers; `grid` cuts planes into tiles; `refine` follows a
boundary through levels; `progress` tells how far a sweep is. No mathematics, no files.

Workers start only if something is to be computed. `cluster.connect` yields a function, which
connects when it is first called; `sweep` calls it if tiles are missing:

    place = store.place_of(out)
    with store.driving(place), cluster.connect(n_workers=2) as client:
        outcome = sweep(client, place, job)

Nothing is prepared in workers beforehand. With each batch of tiles a worker gets all it needs: the
job's functions, whose kernels it compiles or finds on disk before its first tile, and by whom the
cube is computed, so that a worker with other versions, or another disk, says so instead.
"""
