"""The main job: where in the (κ1, κ2) plane does global transport begin?

For now by the direct method alone (arXiv:1606.04824, Sec. V.B): the boundary {n* ≤ N} of first
escape times, for several N. It shows transport, so it is an upper bound, which falls towards the
true boundary only like N^(-1/3).
"""

import click

from workflows.cli import axis_option, cluster_options, session
from workflows.escape_plane import boundaries_at, checked_levels, escape_plane, plane_options


def boundary_table(plane, angles, steps):
    """The boundary of the largest ensemble along rays, a Dataset with dims (n, angle)."""
    import numpy as np
    import xarray as xr

    from nasm.escape import boundary

    field = plane.escape_time.isel(ensemble=-1)
    scale = np.array(
        [boundary(field.values, plane.kappa1.values, plane.kappa2.values, angles, n) for n in steps]
    )
    table = xr.Dataset(
        {
            "critical_scale": (("n", "angle"), scale),
            "kappa1": (("n", "angle"), scale * np.cos(np.deg2rad(angles))),
            "kappa2": (("n", "angle"), scale * np.sin(np.deg2rad(angles))),
        },
        {"n": steps, "angle": angles},
    )
    cell = float(max(plane.kappa1.diff("kappa1")[0], plane.kappa2.diff("kappa2")[0]))
    return table.assign_attrs(resolution=cell, orbits=int(plane.ensemble[-1]))


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@axis_option("--kappa1", "-1:1:1024", "First kick's strength: lower end, upper end, cells.")
@axis_option("--kappa2", "0:1:512", "Second kick's strength, likewise.")
@plane_options(n_max=100_000, n_orbits=64, tile=8, levels=5)
@click.option(
    "--angles",
    default=361,
    show_default=True,
    type=click.IntRange(2, 10**6),
    help="Rays of the table, from 0 to 180 degrees.",
)
@cluster_options
def main(out, cluster, kappa1, kappa2, n_max, n_orbits, tile, levels, angles):
    """The critical boundary of global transport: a cube, a table and a figure in OUT.

    The defaults take about a minute on two cores. The paper's size of job is --n-max 1000000
    --n-orbits 10000.
    """
    checked_levels(kappa1, kappa2, levels)
    with session(out, cluster) as client:
        plane = escape_plane(client, out, kappa1, kappa2, n_max, n_orbits, tile, levels)
        import numpy as np

        from workflows.figures import draw_critical_boundary, save

        steps = boundaries_at(n_max)
        table = boundary_table(plane, np.linspace(0, 180, angles), steps)
        table.to_dataframe().to_csv(f"{out}/critical_boundary.csv", float_format="%.6g")
        figures = save(draw_critical_boundary(plane, table), out, "critical_boundary")
    click.echo(f"cube:   {out}/cubes.zarr, group escape")
    click.echo(f"table:  {out}/critical_boundary.csv, one cell is {table.resolution:.2g}")
    click.echo(f"figure: {', '.join(figures)}")


if __name__ == "__main__":
    main()
