"""How a cube is computed: the missing tiles of it, on a dask cluster, whatever is in them.

Workers start only if tiles are missing: `cluster.connect` yields a function, which `sweep` calls.

    place = store.place_of(out)
    with store.driving(place), cluster.connect(n_workers=2) as client:
        outcome = sweep(client, place, job)

Nothing is prepared in workers beforehand: each batch of tiles carries all that a worker needs.
"""
