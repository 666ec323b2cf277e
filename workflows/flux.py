"""How much passes through the last circle once it is broken? The flux ΔW and its law.

Just beyond CB_gt what is left of the last circle, a cantorus, still holds back transport: the area
that passes in one step is the difference in action of minimax and minimizing orbits, which grows
from 0 like (s/s_c - 1)^η, η = 3.01. An outlook of arXiv:1606.04824, Sec. VII; the method is that of
MacKay, Meiss & Percival, Physica D 13 (1984) 55.
"""

import click

from workflows.cli import HELP, carry_out, cluster_options, session, store_option
from workflows.labelled import write_table
from workflows.last_barrier import unfolded


def flux_job(barrier, excesses, q_max):
    """The cube `flux` on the rays of a table of last barriers."""
    from pipeline.cubes import flux

    rays = barrier.to_dataframe()
    return flux.through_last_circle(
        rays.critical_scale.to_dict(), rays.circle.to_dict(), excesses, q_max
    )


def law(excess, flux):
    """C and η of flux = C·x^η·exp(bx + cx²), by least squares of the logarithms; x the excess ≤ 3%.

    The exponential is the first corrections to the law: without them η comes out 0.01 too small,
    without c 10⁻⁵. Returns (C, η) and the standard errors of the fit; NaN for too few points.
    """
    import numpy as np

    known = np.isfinite(flux) & (flux > 0) & (excess <= 0.031)
    if known.sum() < 6:
        return np.full((2, 2), np.nan)
    x, right = excess[known], np.log(flux[known])
    matrix = np.stack([np.ones_like(x), np.log(x), x, x**2], axis=1)
    found, *_ = np.linalg.lstsq(matrix, right)
    spread = np.sum((right - matrix @ found) ** 2) / (x.size - found.size)
    errors = np.sqrt(spread * np.diag(np.linalg.inv(matrix.T @ matrix)))
    amplitude = np.exp(found[0])
    return np.array([[amplitude, found[1]], [amplitude * errors[0], errors[1]]])


def laws(fluxes):
    """`law` on each ray: a Dataset with dim (angle)."""
    import numpy as np
    import xarray as xr

    fits = np.array([law(fluxes.excess.values, row.values) for row in fluxes.flux])
    names = [["amplitude", "exponent"], ["amplitude_error", "exponent_error"]]
    table = xr.Dataset(coords={"angle": fluxes.angle})
    for i, pair in enumerate(names):
        for j, name in enumerate(pair):
            table[name] = ("angle", fits[:, i, j])
    table["circle"] = ("angle", list(fluxes.attrs["circles"].values()))
    return table


@click.command(context_settings=HELP)
@click.option(
    "--angle",
    multiple=True,
    default=(0.0, 20.0, 30.0, 40.0, 45.0),
    show_default=True,
    type=click.FloatRange(0, 180),
    help="A ray, in degrees; may be repeated.",
)
@click.option(
    "--nearest",
    default=1e-4,
    show_default=True,
    type=click.FloatRange(1e-5, 0.1),
    help="Smallest distance beyond the breakup, in parts of it; the largest is 0.5.",
)
@click.option(
    "--q-max",
    default=200_000,
    show_default=True,
    type=click.IntRange(100, 10**6),
    help="Longest period of the orbits; 10/NEAREST or more.",
)
@store_option
@cluster_options
def main(out, place, cluster, angle, nearest, q_max):
    """The flux through broken circles: two cubes, two tables and a figure in OUT.

    The defaults take a minute on two cores.
    """
    import numpy as np

    from pipeline.cubes import barrier

    rays = np.unique(angle)
    excesses = np.geomspace(nearest, 0.5, 1 + int(8 * np.log10(0.5 / nearest)))
    last = barrier.last_barrier(rays, 1e-3)
    with session(out, cluster, [last], place) as client:
        job = flux_job(unfolded(carry_out(client, place, last), rays), excesses, q_max)
        fluxes = carry_out(client, place, job).load()
        from workflows.figures.flux import caption, draw_flux
        from workflows.figures.style import save

        fits = laws(fluxes)
        write_table(fluxes, f"{out}/flux.csv")
        fits.to_dataframe().to_csv(f"{out}/flux_law.csv", float_format="%.6g")
        figures = save(draw_flux(fluxes, fits), out, "flux", caption(fluxes, fits))
    for angle, row in fits.to_dataframe().iterrows():
        click.echo(f"{angle:g}°, {row.circle}: eta = {row.exponent:.6f} ± {row.exponent_error:.0e}")
    click.echo(f"cubes:  {place}/cubes.zarr, groups barrier and flux")
    click.echo(f"tables: {out}/flux.csv, {out}/flux_law.csv")
    click.echo(f"figure: {', '.join(figures)}")


if __name__ == "__main__":
    main()
