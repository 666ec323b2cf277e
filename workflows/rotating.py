"""How do barriers break in the rotating standard map, κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ)?

In the (κ̄, Δκ) plane (arXiv:1606.04824, Sec. VII, Figs. 10 and 11). T_{κ1κ2} is Ω = 1/2: its
circles, its last barrier CB_gt, and the onset of transport by direct iteration, which lies outside
CB_gt. Two-dimensional tori break near where the residues of long orbits grow whose rotation vectors
approximate theirs; where that is outside CB_gt, tori outlast circles.
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
from workflows.last_barrier import ray_angles, tips_option, unfolded

# The paper's vector of 1705/3136 is the first. 1/τ = 0.543689… and 1/τ + 1/τ² = 0.839286…, τ the
# tribonacci constant, have the convergents of the other two; 2631 may be a misprint of 2632.
VECTORS = ("1705/3136,2631/3136", "1705/3136,2632/3136", "927/1705,1431/1705")


def rotated_rays(n, tips):
    """The rays of `ray_angles`, θ = 45° - φ, as angles of the (κ̄, Δκ) plane; cusps at 0 and 90."""
    import numpy as np

    return np.unique(np.append((45 - ray_angles(n, tips)) % 180, 180.0).round(9))


def two_kicks(barrier, angles):
    """CB_gt of T on rays (κ̄, Δκ) = s·(cos θ, sin θ), from the cube `barrier` of 45° - θ."""
    import numpy as np

    two = unfolded(barrier, 45 - angles)
    two["kappa_mean"] = (two.kappa1 + two.kappa2) / 2
    two["kappa_amplitude"] = (two.kappa1 - two.kappa2) / 2
    for name in ("critical_scale", "error", "lower", "upper"):
        two[name] = two[name].copy(data=two[name] / np.sqrt(2))
    coordinate = ("angle", angles, {"long_name": "direction of the ray", "units": "degree"})
    return two.assign_coords(angle=coordinate)


def compared(tori, two, direct):
    """The cube `rotating_tori` and its scales in parts of CB_gt and of direct iteration."""
    tori = tori.load()
    onset = direct.upper.isel(frequency=0, drop=True)
    for name, scale, words in (
        ("ratio", two.critical_scale, "CB_gt of T"),
        ("ratio_direct", onset, "the onset of transport of T by direct iteration"),
    ):
        tori[name] = tori.critical_scale / scale
        tori[name].attrs = {"long_name": f"scale of the torus over that of {words}", "units": "1"}
    return tori


def _vectors(context, parameter, values):
    """Values like 1/3,2/5: a fraction, and a frequency; sorted by the last."""
    for value in values:
        try:
            parts = [Fraction(part) for part in value.split(",")]
        except (ValueError, ZeroDivisionError):
            parts = []
        if len(parts) != 2 or not 1 < parts[1].denominator <= 10**5:
            raise click.BadParameter(
                f"{value!r} must be two fractions like 1/3,2/5, the last one in lowest terms "
                "between 1/2 and some n/100000"
            )
    values = sorted(values, key=lambda value: Fraction(value.split(",")[1]))
    if len({Fraction(value.split(",")[1]) for value in values}) < len(values):
        raise click.BadParameter("two frequencies are equal")
    return values


@click.command(context_settings=HELP)
@click.option(
    "--vector",
    multiple=True,
    default=VECTORS,
    show_default=True,
    metavar="P/Q,OMEGA",
    callback=_vectors,
    help="Rotation vector of a periodic orbit: turns per kick and frequency. May be repeated.",
)
@angles_option(181)
@tips_option
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
def main(out, place, cluster, vector, angles, tips, n_max, n_orbits):
    """Rotating standard maps: four cubes, a table and two figures in OUT.

    The defaults take 140 CPU seconds, about a minute and a half on two cores.
    """
    from nasm.numbers import NAMES, parse
    from pipeline.cubes import barrier, breakdown, rotating

    circles, rays = sorted(map(parse, NAMES), key=float), rotated_rays(angles, tips)
    jobs = [
        breakdown.by_residue(circles, ray_angles(angles, tips), q_max=6000),
        barrier.last_barrier(45 - rays, 2e-4),
        rotating.transport(rays, n_max, n_orbits),
        rotating.tori(vector, rays),
    ]
    with session(out, cluster, jobs, place) as client:
        circles, last, direct, tori = (carry_out(client, place, job) for job in jobs)
        from workflows.figures import rotating as figure
        from workflows.figures.style import save

        two = two_kicks(last, rays)
        tori = compared(tori, two, direct)
        write_table(tori, f"{out}/tori.csv")
        parts = circles, two, direct
        figures = save(
            figure.draw_rotating_circles(*parts), out, "diamond", figure.circles_caption(*parts)
        )
        parts = tori, two, direct
        figures += save(figure.draw_rotating_tori(*parts), out, "tori", figure.tori_caption(*parts))
    groups = "breakdown_residue, barrier, rotating_transport, rotating_tori"
    click.echo(f"cubes:   {place}/cubes.zarr, groups {groups}")
    click.echo(f"table:   {out}/tori.csv")
    click.echo(f"figures: {', '.join(figures)}")


if __name__ == "__main__":
    main()
