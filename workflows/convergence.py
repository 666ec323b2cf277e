"""How fast does each method converge, in its own measure of effort?

The paper's Fig. 7 and its likes on other rays: the boundary {n* ≤ N} of direct iteration closes in
on the breakup like N^(-1/η) (arXiv:1606.04824, Sec. V.B, with η = 2.681 and 3.322; renormalisation
gives 3.012), in the number of steps N and in the number of orbits M. Beside it converse KAM in N,
Greene's residue in the period q, and certified circles in the number n of grid points.
"""

import click

from workflows.cli import (
    HELP,
    carry_out,
    cluster_options,
    integers_option,
    session,
    store_option,
)

ANGLES = (0.0, 20.0, 40.0, 45.0)


def breakups(angles):
    """{angle: CriticalScale} of the last barrier, to judge the others by."""
    from nasm import barriers
    from nasm.symmetries import ray

    return {angle: barriers.critical_scale(ray(angle), 1e-3) for angle in angles}


def direct_job(scales, sizes, n_max):
    """The cube `escape_rays`: excesses from 1% to 100%, sixty a decade."""
    import numpy as np

    from pipeline.cubes import escape

    return escape.beyond("escape_rays", scales, np.geomspace(0.01, 1.0, 121), sizes, n_max)


def steps_up_to(n_max):
    """33 numbers of steps from 100 to n_max, equally spaced in the logarithm."""
    import numpy as np

    return np.unique(np.rint(np.geomspace(100, n_max, 33)).astype(int))


def direct_bias(cube, steps):
    """κ_N/κ_c - 1 for each N of `steps`: the least excess from which on all escape within N.

    NaN where that is not between two excesses of the cube. What is not computed counts as no
    escape.
    """
    import xarray as xr

    n = xr.DataArray(steps, dims="n", coords={"n": steps})
    n.n.attrs.update(long_name="steps", units="1")
    escaped = (cube.escape_time <= n).isel(excess=slice(None, None, -1))
    beyond = escaped.cumprod("excess").astype(bool)
    bias = cube.excess.where(beyond).min("excess")
    # Where even the least excess escapes, or the largest does not, the boundary is not on the grid.
    known = beyond.any("excess") & ~beyond.all("excess")
    bias = bias.where(known).rename("bias")
    return bias.assign_attrs(long_name="boundary of n* <= N, in parts of the breakup, less 1")


def exponent(n, bias):
    """η and its standard error, of bias ~ n^(-1/η), by a straight line through the logarithms."""
    import numpy as np

    known = np.isfinite(bias)
    (slope, _), covariance = np.polyfit(np.log(n[known]), np.log(bias[known]), 1, cov=True)
    return -1 / slope, np.sqrt(covariance[0, 0]) / slope**2


def on_the_diagonal(bias, critical):
    """κ_N - κ_c on (κ, κ) against N, Fig. 7, with η fitted to the lower and the upper half of N.

    bias : of `direct_bias`, with the angle 45. critical : scale of the breakup there.
    """
    import numpy as np

    from workflows.labelled import labelled, listed

    kappa_c = critical * np.sqrt(0.5)
    distance = kappa_c * bias.sel(angle=45.0).isel(ensemble=-1).transpose("n").values
    n = bias.n.values
    small = n <= np.sqrt(float(n[0]) * float(n[-1]))
    fits = [exponent(n[half], distance[half]) for half in (small, ~small)]
    power_law = n ** (-1 / np.where(small, fits[0][0], fits[1][0]))
    offset = np.log(distance / power_law)
    for half in (small, ~small):
        power_law[half] *= np.exp(np.nanmean(offset[half]))
    return labelled(
        "Convergence of direct iteration at the cusp of the horn",
        {"n": (n, "steps N", "1"), "half": listed("small N", "large N")},
        {
            "distance": (("n",), distance, "κ_N - κ_c on the diagonal (κ, κ)"),
            "fit": (("n",), power_law, "C N^(-1/η), of its half"),
            "upper_half": (("n",), (~small).astype("int8"), "whether N is in the upper half"),
            "eta": (("half",), [eta for eta, _ in fits], "η of κ_N - κ_c ~ N^(-1/η)"),
            "eta_error": (("half",), [error for _, error in fits], "standard error of η"),
        },
        critical=float(kappa_c),
        n_orbits=int(bias.ensemble[-1]),
        source="arXiv:1606.04824, Fig. 7",
    )


def other_methods(breakups, quick):
    """Errors of the other methods: a Dataset with dims (angle, n, q or modes)."""
    import numpy as np
    import xarray as xr

    from nasm import circles, cones, periodic
    from nasm.symmetries import ray

    steps = 10 ** np.arange(2, 5 if quick else 6)
    modes = 2 ** np.arange(7, 11 if quick else 14)
    rows = []
    for angle, best in breakups.items():
        found = [cones.critical_scale(ray(angle), int(n)) for n in steps]
        raw = [scale.upper / best.value - 1 for scale in found]
        corrected = [abs(scale.value / best.value - 1) for scale in found]
        q, scales = periodic.crossings(best.omega, ray(angle), 2000 if quick else 20_000)
        last = [_last_certified(circles, best, ray(angle), int(n)) / best.value for n in modes]
        row = xr.Dataset(
            {
                "cones_raw": ("steps", raw),
                "cones_corrected": ("steps", corrected),
                "residue": ("q", np.abs(scales / best.value - 1)),
                "circles_raw": ("modes", 1 - np.array(last)),
            },
            {"steps": steps, "q": q.astype(int), "modes": modes},
        )
        rows.append(row)
    dataset = xr.concat(
        rows, xr.DataArray(list(breakups), dims="angle", name="angle"), join="outer"
    )
    for variable in dataset.variables.values():
        variable.attrs = {"units": "1", "long_name": "error in parts of the breakup"}
    for name, words in (("steps", "steps N"), ("q", "period"), ("modes", "grid points n")):
        dataset[name].attrs = {"units": "1", "long_name": words}
    dataset.angle.attrs = {"units": "degree", "long_name": "direction of the ray in the plane"}
    return dataset.assign_attrs(title="Convergence of converse KAM, residues and circles")


def _last_certified(circles, best, profile, n):
    """The largest scale below the breakup, to 1% of its distance, with a certified circle."""
    inside, outside = 0.5, 1.0
    while outside - inside > 0.01 * (1 - inside):
        middle = (inside + outside) / 2
        circle = circles.invariant_circle(best.omega, middle * best.value * profile, n_max=n)
        inside, outside = (middle, outside) if circle.certified else (inside, middle)
    return inside * best.value


@click.command(context_settings=HELP)
@click.option(
    "--n-max",
    default=1_000_000,
    show_default=True,
    type=click.IntRange(1000, 10**9),
    help="Steps of direct iteration.",
)
@integers_option(
    "--n-orbits",
    "10,30,100,300,1000",
    10**8,
    "Orbits of the ensembles of direct iteration, increasing.",
)
@click.option(
    "--quick",
    is_flag=True,
    help="A preview: 10 000 steps, and short runs of the other methods.",
)
@store_option
@cluster_options
def main(out, place, cluster, n_max, n_orbits, quick):
    """Convergence studies: three cubes, a table and two figures in OUT.

    About three minutes on two cores; ten times the steps or orbits take ten times as long.
    """
    n_max = min(n_max, 10_000) if quick else n_max
    best = breakups(ANGLES)
    scales = {angle: float(scale.value) for angle, scale in best.items()}
    job = direct_job(scales, n_orbits, n_max)
    with session(out, cluster, [job], place) as client:
        bias = direct_bias(carry_out(client, place, job).load(), steps_up_to(n_max))
        from pipeline import store
        from pipeline.cubes.cube import Cube
        from workflows.figures import convergence as drawing
        from workflows.figures.style import save

        others = other_methods(best, quick)
        store.replace(place, Cube("convergence", others, {}, {"quick": quick}))
        fits = {
            angle: exponent(bias.n.values, bias.sel(angle=angle).isel(ensemble=-1).values)
            for angle in ANGLES
        }
        bias.to_dataframe().to_csv(f"{out}/convergence_direct.csv", float_format="%.6g")
        figure, words = drawing.draw_convergence(bias, others, fits), drawing.describe(bias, fits)
        figures = save(figure, out, "convergence", words)
        diagonal = on_the_diagonal(bias, scales[45.0])
        store.replace(place, Cube("convergence_diagonal", diagonal, {}, {}))
        figure, words = drawing.draw_diagonal(diagonal), drawing.describe_diagonal(diagonal)
        figures += save(figure, out, "convergence_diagonal", words)
    for angle, (eta, deviation) in fits.items():
        click.echo(f"direct iteration at {angle:g}°: eta = {eta:.2f} ± {deviation:.2f}")
    click.echo(
        f"cubes:   {place}/cubes.zarr, groups escape_rays, convergence and convergence_diagonal"
    )
    click.echo(f"table:   {out}/convergence_direct.csv")
    click.echo(f"figures: {', '.join(figures)}")


if __name__ == "__main__":
    main()
