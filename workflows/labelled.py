"""Small labelled Datasets for studies that are no sweeps, and tables of any Dataset."""


def listed(*names):
    return range(len(names)), list(names), "1"


def status_code(status):
    from pipeline.cubes.cube import status_code

    return status_code(status)


def status_flags(codes):
    """A variable of codes of Status, for `labelled`."""
    import numpy as np

    from pipeline.cubes.cube import FLAGS

    return np.asarray(codes).astype("int8"), {"long_name": "status of the method", **FLAGS}


def labelled(title, coords, variables, **attrs):
    """A Dataset; variables without dims have all of them, in the order of the coordinates."""
    import numpy as np
    import xarray as xr

    dataset = xr.Dataset(attrs={"title": title, **attrs})
    for name, (values, long_name, units) in coords.items():
        attrs = {"long_name": long_name, "units": units}
        if isinstance(long_name, list):
            attrs = {"long_name": name, "units": units, "names": long_name}
        dataset[name] = xr.DataArray(np.array(values), dims=name, attrs=attrs)
    for name, (*dims, values, words) in variables.items():
        dims = dims[0] if dims else tuple(coords)
        dataset[name] = xr.DataArray(values, dims=dims, attrs={"units": "1"})
        dataset[name].attrs |= words if isinstance(words, dict) else {"long_name": words}
    return dataset


def write_table(dataset, path):
    """The Dataset as a CSV table, outcomes as words, without what a sweep noted about its tiles."""
    tiles = [dim for dim in dataset.dims if str(dim).startswith("tile_")]
    table = dataset.drop_dims(tiles).to_dataframe()
    for name in table:
        words = dataset[name].attrs.get("flag_meanings")
        if words is not None:
            codes = dataset[name].attrs["flag_values"]
            table[name] = table[name].map(dict(zip(codes, words.split(), strict=True)))
    table.to_csv(path, float_format="%.12g")
