"""How far outside the true boundary does direct iteration put it? Figs. 5 and 6 of the paper.

On each ray κ = s·(cos φ, sin φ) the scale s_N beyond which some orbit of the ensemble leaves the
window within N steps (arXiv:1606.04824, Sec. V.B), against the breakup s_c by residues.

1. Find s_c on each ray, between a certified circle and converse KAM; see `last_barrier`.
2. From s = 2·s_c inwards compute first escape times, thirty scales to a decade of s/s_c - 1, and
   leave a ray at the first scale without escape. Escapes far out are quick, and scales without
   escape, which cost M·N orbit steps each, are computed once a ray.
3. s_N is the least scale from which on all escaped: an upper bound of s_c.

The insets of Fig. 6: how often one long orbit visits each part of the cell, at four forcings.
"""

import click

from workflows.cli import (
    HELP,
    angles_option,
    carry_out,
    cluster_options,
    integers_option,
    session,
    store_option,
)
from workflows.convergence import direct_bias
from workflows.labelled import labelled
from workflows.last_barrier import ray_angles, tips_option, unfolded

INSETS = ((0.526, 0.69), (0.526, 0.73), (-0.69, 0.525), (-0.73, 0.525))
INSET_START = (0.5, 0.44)
INSET_STEPS = 3_000_000
_PIXELS = 400


def direct_job(barrier, n_max, n_orbits):
    """The cube `direct_boundary`: one ensemble on the rays of `barrier`, excesses 1% to 100%."""
    import numpy as np

    from pipeline.cubes import escape

    scales = dict(zip(barrier.angle.values.tolist(), barrier.critical_scale.values, strict=True))
    return escape.beyond("direct_boundary", scales, np.geomspace(0.01, 1, 61), [n_orbits], n_max)


def inwards(client, place, job):
    """Sweep the job's cube from the largest excess inwards, on each ray to the first no-escape."""
    import sys

    from pipeline.progress import Progress

    rays = range(job.cube.sizes["angle"])
    with Progress(job.cube.name, sys.stderr) as progress:
        for excess in reversed(range(job.cube.sizes["excess"])):
            wanted = {(ray, excess) for ray in rays}
            found = carry_out(client, place, job, wanted, progress)
            times = found.escape_time[-1, :, excess].values
            rays = [ray for ray in rays if times[ray] <= job.cube.settings["n_max"]]
            if not rays:
                break
    return found.load()


def boundary_dataset(found, barrier, steps):
    """The boundary {n* ≤ N} on rays, dims (n, angle), and how unsymmetric it is; see `asymmetry`.

    critical_scale is s_N, bias s_N/s_c - 1; resolution is how much less s_N might be on the cube's
    grid.
    """
    import numpy as np

    from nasm.symmetries import ray

    breakup, angle = barrier.critical_scale.values, found.angle.values
    bias = direct_bias(found, steps).isel(ensemble=0).transpose("n", "angle").values
    scale = breakup * (1 + bias)
    spacing = 1 - float(found.excess[0] / found.excess[1])
    kappa1, kappa2 = np.moveaxis(scale[..., None] * ray(angle), -1, 0)
    by_step = "n", "angle"
    return labelled(
        "Boundary of global transport by direct iteration",
        {
            "n": (steps, "steps N", "1"),
            "angle": (angle, "direction of the ray in the plane", "degree"),
            "excess": (found.excess.values, "scale in parts of the breakup's, less 1", "1"),
        },
        {
            "critical_scale": (by_step, scale, "scale from which on some orbit escapes"),
            "bias": (by_step, bias, "critical_scale in parts of the breakup, less 1"),
            "resolution": (by_step, spacing * bias * breakup, "spacing of the scales there"),
            "kappa1": (by_step, kappa1, "strength of the first kick"),
            "kappa2": (by_step, kappa2, "strength of the second kick"),
            **asymmetry(angle, scale, found.escape_time.isel(ensemble=0).values),
        },
        n_orbits=int(found.ensemble[0]),
        spacing=spacing,
        source="arXiv:1606.04824, Sec. V.B, Figs. 5 and 6",
    )


def asymmetry(angle, scale, times):
    """What a boundary of the square's symmetry would have 0 for, as variables of a Dataset.

    swap and mirror compare s_N, dims (n, angle), with that of the ray's image in κ1 ↔ κ2 and
    κ1 → -κ1; swap_times and mirror_times compare n* itself, dims (angle, excess), which no grid
    rounds. NaN where the image is the ray itself, or not one of the rays.
    """
    import numpy as np

    times = np.where(np.isfinite(times) & (times > 0), times, np.nan)
    variables = {}
    for name, image, words in (
        ("swap", (90 - angle) % 180, "that of the image in κ1 ↔ κ2"),
        ("mirror", 180 - angle, "that of the image in κ1 → -κ1"),
    ):
        other = _of_images(scale, angle, image)
        ratio = times / _of_images(times.T, angle, image).T
        variables[name] = (
            ("n", "angle"),
            2 * (scale - other) / (scale + other),
            f"critical_scale less {words}, in parts of their mean",
        )
        variables[f"{name}_times"] = (("angle", "excess"), np.log(ratio), f"ln of n* over {words}")
    return variables


def _of_images(values, angle, image):
    """The values, with angles along the last axis, of the rays at the angles `image`."""
    import numpy as np

    place = {degrees: i for i, degrees in enumerate(angle.tolist())}
    there = np.array([place.get(degrees, -1) for degrees in image.round(9).tolist()])
    return np.where((there < 0) | (there == np.arange(angle.size)), np.nan, values[..., there])


def insets_dataset():
    """Visits of one orbit to the parts of the cell, dims (forcing, y, x), and how far it went."""
    import numpy as np

    from nasm import orbits

    visits, lowest, highest = [], [], []
    for kappa in INSETS:
        x, y = orbits.orbit(kappa, *INSET_START, INSET_STEPS)
        cells = np.histogram2d(y % 1.0, x % 1.0, _PIXELS, [[0, 1], [0, 1]])[0]
        visits.append(cells.astype("uint32"))
        lowest.append(y.min())
        highest.append(y.max())
    kappa1, kappa2 = np.transpose(INSETS)
    centres = (np.arange(_PIXELS) + 0.5) / _PIXELS
    return labelled(
        "Visits of one orbit to the parts of the cell",
        {
            "forcing": (range(len(INSETS)), "forcing", "1"),
            "y": (centres, "y mod 1", "1"),
            "x": (centres, "x mod 1", "1"),
        },
        {
            "visits": (np.stack(visits), "points of the orbit"),
            "kappa1": (("forcing",), kappa1, "strength of the first kick"),
            "kappa2": (("forcing",), kappa2, "strength of the second kick"),
            "lowest": (("forcing",), lowest, "least y of the orbit, not reduced"),
            "highest": (("forcing",), highest, "largest y of the orbit, not reduced"),
        },
        start=list(INSET_START),
        steps=INSET_STEPS,
        source="arXiv:1606.04824, Fig. 6",
    )


@click.command(context_settings=HELP)
@integers_option("--steps", "100000,500000,1000000", 10**9, "Steps N, increasing.")
@click.option(
    "--n-orbits",
    default=10_000,
    show_default=True,
    type=click.IntRange(1, 10**8),
    help="Orbits of the ensemble.",
)
@angles_option(181)
@tips_option
@store_option
@cluster_options
def main(out, place, cluster, steps, n_orbits, angles, tips):
    """The boundary by direct iteration: three cubes, a table and two figures in OUT.

    The defaults are the paper's size: 40 CPU seconds a ray, two hours in all. A tenth of the steps
    and a tenth of the orbits take a hundredth of that.
    """
    from pipeline.cubes.barrier import last_barrier

    rays = ray_angles(angles, tips)
    last_job = last_barrier(rays, 1e-4)
    with session(out, cluster, [last_job], place) as client:
        import numpy as np

        from pipeline import store
        from pipeline.cubes.cube import Cube
        from workflows.figures import direct_boundary as figures
        from workflows.figures.style import save

        barrier = unfolded(carry_out(client, place, last_job), rays)
        # Direct iteration is too coarse to resolve the tips.
        spread = np.linspace(0, 180, angles).round(9)
        known = barrier.sel(angle=spread).dropna("angle", subset=["critical_scale"])
        boundary = boundary_dataset(
            inwards(client, place, direct_job(known, steps[-1], n_orbits)), known, steps
        )
        store.replace(place, insets := Cube("direct_insets", insets_dataset(), {}, {}))
        for n, lost in zip(steps, boundary.bias.isnull().sum("angle").values, strict=True):
            if lost:
                click.echo(f"N = {n}: no boundary on {lost} rays from 1% to 100% outside", err=True)
        boundary.drop_dims("excess").to_dataframe().to_csv(
            f"{out}/direct_boundary_rays.csv", float_format="%.6g"
        )
        caption = figures.describe(boundary)
        drawn = save(figures.draw_quadrant(boundary, barrier), out, "direct_quadrant", caption)
        drawn += save(
            figures.draw_half_plane(boundary, barrier, insets.template),
            out,
            "direct_boundary",
            f"{caption} {figures.describe_insets(insets.template)}",
        )
    click.echo(f"cubes:   {place}/cubes.zarr, groups direct_boundary, direct_insets and barrier")
    click.echo(f"table:   {out}/direct_boundary_rays.csv")
    click.echo(f"figures: {', '.join(drawn)}")


if __name__ == "__main__":
    main()
