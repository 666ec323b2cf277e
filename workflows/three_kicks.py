"""Where do the barriers of three kicks outlast those of two? The rotating map with Ω = 1/3.

The boundary of global transport of κ_n = κ̄ + Δκ cos 2π(φ0 + n/3) in the (κ̄, Δκ) plane, for several
phases φ0, against that of T_{κ1κ2}, which is Ω = 1/2 (arXiv:1606.04824, Sec. VII).

The boundary is the same for φ0 + 1/3, where the kicks start one later; for -φ0, where they come in
reverse; for φ0 + 1/2 and -Δκ; and for -κ̄ and -Δκ. So all phases are those from 0 to 1/12, with both
signs of Δκ; at 1/12 these are alike. Except at φ0 = 0 the kicks have no symmetry centre, and the
barrier is found by converse KAM on transversals, `nasm.transversals`.
"""

from fractions import Fraction

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
from workflows.last_barrier import tips_option
from workflows.rotating import rotated_rays, two_kicks

PHASES = ("0", "1/48", "1/24", "1/16", "1/12")


def compared(three, two):
    """The cube `three_kicks` with the `ratio` of its scales to those of T on the same rays."""
    three = three.load()
    three["ratio"] = three.critical_scale / two.critical_scale
    three["ratio"].attrs = {"long_name": "scale of three kicks over that of two", "units": "1"}
    return three


def _parse_phases(context, parameter, values):
    for value in values:
        try:
            phase = Fraction(value)
        except (ValueError, ZeroDivisionError):
            phase = -1
        if not 0 <= phase < 1:
            raise click.BadParameter(f"{value!r} must be a fraction from 0 to below 1, like 1/24")
    values = sorted(values, key=Fraction)
    if len(set(map(Fraction, values))) < len(values):
        raise click.BadParameter("two phases are equal")
    return values


@click.command(context_settings=HELP)
@click.option(
    "--phase",
    multiple=True,
    default=PHASES,
    show_default=True,
    metavar="FRACTION",
    callback=_parse_phases,
    help="Phase φ0 of the forcing, in turns. May be repeated.",
)
@angles_option(61)
@tips_option
@click.option(
    "--n-max",
    default=300,
    show_default=True,
    type=click.IntRange(30, 10**5),
    help="Steps (of three kicks) of converse KAM; the upper bound is 0.7/N above the value.",
)
@store_option
@cluster_options
def main(out, place, cluster, phase, angles, tips, n_max):
    """Rotating standard maps with Ω = 1/3: two cubes, a table and a figure in OUT.

    The defaults take some nine CPU minutes, about five minutes on two cores.
    """
    from pipeline.cubes import barrier, rotating

    rays = rotated_rays(angles, tips)
    jobs = [rotating.three_kicks(phase, rays, n_max), barrier.last_barrier(45 - rays, 1e-3)]
    with session(out, cluster, jobs, place) as client:
        three, last = (carry_out(client, place, job) for job in jobs)
        from workflows.figures.style import save
        from workflows.figures.three_kicks import caption, draw_three_kicks

        two = two_kicks(last, rays)
        three = compared(three, two)
        write_table(three, f"{out}/three_kicks.csv")
        figures = save(draw_three_kicks(three, two), out, "three_kicks", caption(three))
    click.echo(f"cubes:  {place}/cubes.zarr, groups three_kicks and barrier")
    click.echo(f"table:  {out}/three_kicks.csv")
    click.echo(f"figure: {', '.join(figures)}")


if __name__ == "__main__":
    main()
