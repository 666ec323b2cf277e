"""At which forcings does the circle of rotation number ω break? The boundaries CB_ω.

By Greene's residue, along rays of the (κ1, κ2) plane, for the paper's six rotation numbers
(arXiv:1606.04824, Sec. VI, Fig. 8) or any others.
"""

import click

from workflows.cli import HELP, cluster_options, finish, session


def circle_boundaries(client, out, omegas, angles, q_max):
    """Compute the cube `breakdown_residue` into the store in `out`; returns it as a Dataset."""
    from pipeline import schema, store, tasks
    from pipeline.sweep import sweep

    cube = schema.breakdown_cube(
        "breakdown_residue",
        {str(omega): float(omega) for omega in omegas},
        angles,
        [status.name.lower() for status in tasks.STATUSES],
        tile=20,
        settings={"method": "Greene's residue", "q_max": q_max},
    )
    finish(sweep(client, out, cube, tasks.residue_tile, tasks.residue_cost))
    return store.read(out, cube.name)


def _parse_omegas(context, parameter, value):
    from nasm.numbers import NAMES, parse

    try:
        omegas = [parse(text) for text in value or NAMES]
    except ValueError as error:
        raise click.BadParameter(str(error)) from None
    if len({float(omega) for omega in omegas}) < len(omegas):
        raise click.BadParameter("two rotation numbers are equal, or equal as floats")
    return sorted(omegas, key=float)


@click.command(context_settings=HELP)
@click.option(
    "--omega",
    multiple=True,
    callback=_parse_omegas,
    help="Rotation number, 2gamma+1 or [1;4,(1)]; may be repeated.  [default: the paper's six]",
)
@click.option(
    "--angles",
    default=361,
    show_default=True,
    type=click.IntRange(2, 10**6),
    help="Rays, from 0 to 180 degrees.",
)
@click.option(
    "--q-max",
    default=6000,
    show_default=True,
    type=click.IntRange(10, 10**6),
    help="Longest period of the orbits used.",
)
@cluster_options
def main(out, cluster, omega, angles, q_max):
    """The boundaries CB_ω of circles: a cube, a table and a figure in OUT."""
    import numpy as np

    with session(out, cluster, "residue") as client:
        dataset = circle_boundaries(client, out, omega, np.linspace(0, 180, angles), q_max)
        from workflows.figures import draw_circle_boundaries, save

        table = dataset.drop_dims([dim for dim in dataset.dims if str(dim).startswith("tile_")])
        table.to_dataframe().to_csv(f"{out}/circle_boundaries.csv", float_format="%.12g")
        figures = save(draw_circle_boundaries(dataset), out, "circle_boundaries")
    click.echo(f"cube:   {out}/cubes.zarr, group breakdown_residue")
    click.echo(f"table:  {out}/circle_boundaries.csv")
    click.echo(f"figure: {', '.join(figures)}")


if __name__ == "__main__":
    main()
