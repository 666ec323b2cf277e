"""At which forcings does the circle of rotation number ω break? The boundaries CB_ω.

Along rays of the (κ1, κ2) plane, for the paper's six rotation numbers (arXiv:1606.04824, Sec. VI,
Figs. 8 and 9) or any others, by two methods: the paper's, circles continued to their breakdown,
and Greene's residue, which is sharper and knows nothing of circles.
"""

import click

from workflows.cli import (
    HELP,
    angles_option,
    carry_out,
    cluster_options,
    session,
    store_option,
)
from workflows.labelled import write_table
from workflows.last_barrier import ray_angles, tips_option, unfolded


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
@angles_option(361)
@tips_option
@click.option(
    "--tol",
    default=1e-4,
    show_default=True,
    type=click.FloatRange(1e-7, 0.1),
    help="Error of the continuation to aim at.",
)
@click.option(
    "--q-max",
    default=6000,
    show_default=True,
    type=click.IntRange(10, 10**6),
    help="Longest period of the orbits of the residue method.",
)
@store_option
@cluster_options
def main(out, place, cluster, omega, angles, tips, tol, q_max):
    """The boundaries CB_ω of circles: two cubes, a table of each and two figures in OUT.

    The defaults take a minute and a half on two cores.
    """
    from pipeline.cubes import barrier, breakdown

    rays = ray_angles(angles, tips)
    jobs = [
        breakdown.by_continuation(omega, rays, tol),
        breakdown.by_residue(omega, rays, q_max),
        barrier.last_barrier(rays, 1e-3),
    ]
    with session(out, cluster, jobs, place) as client:
        circles, residues, last = (carry_out(client, place, job) for job in jobs)
        from workflows.figures.circle_boundaries import (
            circles_caption,
            draw_circle_boundaries,
            draw_tips,
            tips_caption,
        )
        from workflows.figures.style import save

        last = unfolded(last, rays)
        write_table(circles, f"{out}/circle_boundaries.csv")
        write_table(residues, f"{out}/circle_boundaries_residue.csv")
        figures = save(
            draw_circle_boundaries(circles, last),
            out,
            "circle_boundaries",
            circles_caption(residues, circles, last),
        )
        figures += save(
            draw_tips(residues, circles, last), out, "tips", tips_caption(residues, circles)
        )
    click.echo(f"cubes:   {place}/cubes.zarr, groups breakdown, breakdown_residue and barrier")
    click.echo(f"tables:  {out}/circle_boundaries.csv, {out}/circle_boundaries_residue.csv")
    click.echo(f"figures: {', '.join(figures)}")


if __name__ == "__main__":
    main()
