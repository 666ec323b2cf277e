"""Where are the period-one orbits stable, and where do the secondary ones exist? Figs. 3 and 4.

The primary points' residues and the secondary points next to (1/2, 0), with the error of the
paper's cubic estimate (arXiv:1606.04824, Sec. IV). Exact formulas and one equation to solve: no
sweep, a few seconds.
"""

import click

from workflows.cli import HELP, axis_option, driver


def primary_dataset(axis):
    """Residues of the primary points over the plane axis × axis; dims (point, kappa2, kappa1)."""
    import xarray as xr

    from nasm.fixed_points import PRIMARY, primary_residue

    kappa1, kappa2 = _plane(axis)
    residue = primary_residue(*xr.broadcast(kappa1, kappa2)).transpose(0, 2, 1)
    points = [f"({x:g}, {y:g})" for x, y in PRIMARY]
    attrs = {
        "long_name": "Greene's residue; stable if 0 < R < 1",
        "units": "1",
        "source": "arXiv:1606.04824, Sec. IV.A and Fig. 3",
    }
    coords = {"point": range(len(points)), "kappa2": kappa2, "kappa1": kappa1}
    dataset = xr.Dataset({"residue": (tuple(coords), residue, attrs)}, coords)
    dataset.point.attrs = {"long_name": "primary point (x, y)", "units": "1", "points": points}
    return dataset.assign_attrs(title="Primary period-one orbits")


def secondary_dataset(axis):
    """The secondary point next to (1/2, 0) over the plane axis × axis; NaN where there is none."""
    import numpy as np
    import xarray as xr

    from nasm import fixed_points

    kappa1, kappa2 = _plane(axis)
    first, second = np.meshgrid(kappa1, kappa2)
    z, x, y = fixed_points.secondary(first, second)
    residue = np.full(z.shape, np.nan)
    for index in zip(*np.nonzero(np.isfinite(z)), strict=True):
        residue[index] = fixed_points.residue((first[index], second[index]), x[index], y[index])
    estimate_error = np.abs(fixed_points.cubic_estimate(first, second) - z)
    quantities = {
        "z": (z, "distance 2πx - π from (1/2, 0)"),
        "x": (x, "x of the point, in turns"),
        "y": (y, "y of the point"),
        "residue": (residue, "Greene's residue; stable if 0 < R < 1"),
        "estimate_error": (estimate_error, "error of z by the cubic estimate, its sign corrected"),
    }
    dataset = xr.Dataset(
        {
            name: (("kappa2", "kappa1"), values, {"long_name": long_name, "units": "1"})
            for name, (values, long_name) in quantities.items()
        },
        {"kappa2": kappa2, "kappa1": kappa1},
    )
    return dataset.assign_attrs(
        title="Secondary period-one orbits", source="arXiv:1606.04824, Sec. IV.A and Fig. 4"
    )


def _plane(axis):
    import xarray as xr

    return [
        xr.DataArray(axis.centres, dims=name, attrs={"long_name": long_name, "units": "1"})
        for name, long_name in (
            ("kappa1", "strength of the first kick"),
            ("kappa2", "strength of the second kick"),
        )
    ]


@click.command(context_settings=HELP)
@axis_option("--primary", "-4:4:400", "Strengths of both kicks for the primary points.")
@axis_option("--secondary", "0:8:200", "Strengths of both kicks for the secondary points.")
@click.option("--out", default="out", show_default=True, help="Directory of the results.")
def main(out, primary, secondary):
    """Period-one orbits: two cubes and two figures in OUT."""
    with driver(out):
        from pipeline import store
        from pipeline.cubes.cube import Cube
        from workflows.figures import period_one as draw
        from workflows.figures.style import save

        cubes = [
            Cube("period_one_primary", primary_dataset(primary), {}, {}),
            Cube("period_one_secondary", secondary_dataset(secondary), {}, {}),
        ]
        for cube in cubes:
            store.refuse_different(out, cube)
        for cube in cubes:
            store.replace(out, cube)
        first, second = (cube.template for cube in cubes)
        primary = draw.draw_primary_points(first), out, "period_one_primary"
        secondary = draw.draw_secondary_points(second), out, "period_one_secondary"
        figures = save(*primary, draw.primary_caption(first))
        figures += save(*secondary, draw.secondary_caption(second))
    click.echo(f"cubes:   {out}/cubes.zarr, groups period_one_primary and period_one_secondary")
    click.echo(f"figures: {', '.join(figures)}")


if __name__ == "__main__":
    main()
