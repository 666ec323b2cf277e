"""The main job: where in the (κ1, κ2) plane does global transport begin?

For now by the direct method alone (arXiv:1606.04824, Sec. V.B): the boundary {n* ≤ N} of first
escape times. It shows transport, so it is an upper bound, which falls towards the
true boundary only like N^(-1/3).
"""

import click

from workflows.cli import HELP, cluster_options, session
from workflows.escape_plane import escape_plane, plane_options


def boundary_table(dataset, angles, steps):
    """The boundary of the largest ensemble along rays: a Dataset with dims (n, angle).

    critical_scale is the distance from the origin, resolution the cell's width there.
    """
    import numpy as np
    import xarray as xr

    from nasm.escape import boundary

    field = dataset.escape_time.isel(ensemble=-1)
    axes = dataset.kappa1.values, dataset.kappa2.values
    scale = xr.DataArray(
        [boundary(field.values, *axes, angles, n) for n in steps],
        {"n": steps, "angle": angles},
        ("n", "angle"),
    )
    radians = np.deg2rad(scale.angle)
    table = xr.Dataset(
        {
            "kappa1": scale * np.cos(radians),
            "kappa2": scale * np.sin(radians),
            "critical_scale": scale,
        }
    )
    cell = max(np.ptp(axis[:2]) for axis in axes)
    if "level" in dataset:
        level = dataset.level
        there = table[["kappa1", "kappa2"]].fillna(0)  # NaN has no nearest cell
        here = level.sel(kappa1=there.kappa1, kappa2=there.kappa2, method="nearest")
        cell = cell * 2.0 ** (level.max() - here.drop_vars(["kappa1", "kappa2"]))
    table["resolution"] = cell + 0 * scale
    return table


@click.command(context_settings=HELP)
@plane_options("-1.1:1.1:512", "0:1.1:256", n_max=100_000, n_orbits=64, tile=8, levels=4)
@click.option(
    "--angles",
    default=361,
    show_default=True,
    type=click.IntRange(2, 10**5),
    help="Rays of the table: from 0 to 180 degrees, to 360 if the plane has negative kappa2.",
)
@cluster_options
def main(out, cluster, plane, angles):
    """The critical boundary of global transport: a cube, a table and a figure in OUT.

    The defaults take about a minute on two cores. The paper's size of job is --n-max 1000000
    --n-orbits 10000.
    """
    with session(out, cluster, "escape") as client:
        dataset = escape_plane(client, out, plane)
        import numpy as np

        from workflows.figures import draw_critical_boundary, save

        half_turns = 2 if plane.kappa2.lo < 0 else 1
        rays = np.linspace(0, 180 * half_turns, angles)
        table = boundary_table(dataset, rays, plane.drawn)
        for n in table.n.values[table.critical_scale.isnull().all("angle")]:
            click.echo(f"no ray passes into transport within {n} steps in this plane", err=True)
        table.to_dataframe().to_csv(f"{out}/critical_boundary.csv", float_format="%.6g")
        figures = save(draw_critical_boundary(dataset, table), out, "critical_boundary")
    click.echo(f"cube:   {out}/cubes.zarr, group escape")
    click.echo(f"table:  {out}/critical_boundary.csv")
    click.echo(f"figure: {', '.join(figures)}")


if __name__ == "__main__":
    main()
