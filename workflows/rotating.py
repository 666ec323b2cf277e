"""How do barriers break in the rotating standard map, κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ)?

In the (κ̄, Δκ) plane (arXiv:1606.04824, Sec. VII, Figs. 10 and 11): the circles of T_{κ1κ2},
which is Ω = 1/2; the onset of global transport for Ω = 1/2, 1/3 and others by direct iteration; and
the breakup of two-dimensional tori, by the residue of long orbits whose rotation vectors
approximate theirs.
"""

from fractions import Fraction

import click

from workflows.circle_boundaries import residue_job
from workflows.cli import (
    HELP,
    Job,
    angles_option,
    carry_out,
    cluster_options,
    session,
    store_option,
)

# The paper's vector of 1705/3136 is the first. 1/τ = 0.543689… and 1/τ + 1/τ² = 0.839286…, τ the
# tribonacci constant, have the convergents of the other two; 2631 may be a misprint of 2632.
VECTORS = ("1705/3136,2631/3136", "1705/3136,2632/3136", "927/1705,1431/1705")


def tori_job(vectors, angles):
    """The cube `rotating_tori`."""
    from pipeline import tasks

    frequencies = [vector.split(",")[1] for vector in vectors]
    settings = {"method": "Greene's residue of one orbit", "vectors": list(vectors)}
    cube = _cube("rotating_tori", frequencies, angles, 20, settings)
    return Job(cube, tasks.torus_tile, tasks.torus_cost)


def transport_job(frequencies, phase, angles, n_max, n_orbits):
    """The cube `rotating_transport`."""
    from pipeline import tasks

    settings = {
        "method": "direct iteration",
        "phase": phase,
        "n_max": n_max,
        "n_orbits": n_orbits,
    }
    cube = _cube("rotating_transport", frequencies, angles, 10, settings)
    return Job(cube, tasks.transport_tile, tasks.transport_cost)


def _cube(name, frequencies, angles, tile, settings):
    from pipeline import schema, tasks

    exact = {text: float(Fraction(text)) for text in frequencies}
    statuses = [status.name.lower() for status in tasks.STATUSES]
    return schema.rotating_cube(name, exact, angles, statuses, tile, settings)


def _fractions(count):
    """Values like 1/3, or 1/3,2/5, with `count` fractions each; sorted by the last."""

    def parse(context, parameter, values):
        for value in values:
            try:
                parts = [Fraction(part) for part in value.split(",")]
            except (ValueError, ZeroDivisionError):
                parts = []
            if len(parts) != count or not 1 < parts[-1].denominator <= 10**5:
                raise click.BadParameter(
                    f"{value!r} must be {' and '.join(['a fraction'] * count)} like "
                    f"{','.join(['1/3', '2/5'][:count])}, the last one in lowest terms between 1/2 "
                    "and some n/100000"
                )
        values = sorted(values, key=lambda value: Fraction(value.split(",")[-1]))
        if len({Fraction(value.split(",")[-1]) for value in values}) < len(values):
            raise click.BadParameter("two frequencies are equal")
        return values

    return parse


@click.command(context_settings=HELP)
@click.option(
    "--vector",
    multiple=True,
    default=VECTORS,
    show_default=True,
    metavar="P/Q,OMEGA",
    callback=_fractions(2),
    help="Rotation vector of a periodic orbit: turns per kick and frequency. May be repeated.",
)
@click.option(
    "--frequency",
    multiple=True,
    default=("1/2", "1/3"),
    show_default=True,
    metavar="OMEGA",
    callback=_fractions(1),
    help="Frequency of the forcing, for transport by direct iteration. May be repeated.",
)
@click.option(
    "--phase",
    default=0.0,
    show_default=True,
    type=click.FloatRange(0, 1, max_open=True),
    help="Phase φ0 of the forcing, in turns, for transport.",
)
@angles_option(181)
@click.option(
    "--n-max",
    default=20_000,
    show_default=True,
    type=click.IntRange(64, 10**12),
    help="Steps (periods of the forcing) of direct iteration.",
)
@click.option(
    "--n-orbits",
    default=256,
    show_default=True,
    type=click.IntRange(1, 10**8),
    help="Orbits of direct iteration.",
)
@store_option
@cluster_options
def main(out, place, cluster, vector, frequency, phase, angles, n_max, n_orbits):
    """Rotating standard maps: three cubes and two figures in OUT."""
    import numpy as np

    from nasm.numbers import NAMES, parse

    rays = np.linspace(0, 180, angles)
    jobs = [
        residue_job(sorted(map(parse, NAMES), key=float), rays, q_max=6000),
        transport_job(frequency, phase, rays, n_max, n_orbits),
        tori_job(vector, rays),
    ]
    with session(out, cluster, ["escape", "residue"], [job.cube for job in jobs], place) as client:
        circles, direct, tori = (carry_out(client, place, job) for job in jobs)
        from workflows.figures.rotating import draw_rotating_circles, draw_rotating_tori
        from workflows.figures.style import save

        figures = save(draw_rotating_tori(tori, direct), out, "tori")
        if 0.5 in direct.frequency:
            figures += save(draw_rotating_circles(circles, direct), out, "diamond")
    groups = "breakdown_residue, rotating_transport, rotating_tori"
    click.echo(f"cubes:   {place}/cubes.zarr, groups {groups}")
    click.echo(f"figures: {', '.join(figures)}")


if __name__ == "__main__":
    main()
