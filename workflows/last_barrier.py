"""Where does the last barrier to transport break, and which circle is it? CB_gt from both sides.

Each ray has its value by Greene's residue, a certified circle below it and converse KAM above it.
CB_gt has the symmetries of the square (arXiv:1606.04824, Sec. III), so that rays are folded into
the wedge 0 ≤ κ2 ≤ κ1 before they are computed.
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


def unfolded(barrier, angles):
    """The cube `barrier` on any rays whose images it holds: a Dataset with dim (angle).

    `circle` is the exact text of the last circle's ω in [0, 1]; that of 2 - ω is its mirror image.
    """
    import numpy as np
    import xarray as xr

    from nasm.symmetries import fold, ray

    wedge, mirrored = fold(angles)
    barrier = barrier.load()
    there = barrier.sel(angle=wedge, method="nearest", tolerance=1e-8)
    circles = [
        _circle(there.quotients.values[:, i].tolist(), int(there.tail_length[i]), mirror)
        for i, mirror in enumerate(mirrored)
    ]
    scales = ["critical_scale", "error", "lower", "upper", "status"]
    table = xr.Dataset({key: ("angle", there[key].values, there[key].attrs) for key in scales})
    table = table.assign_coords(angle=("angle", angles, barrier.angle.attrs))
    for name, direction in zip(("kappa1", "kappa2"), ray(angles).T, strict=True):
        table[name] = table.critical_scale * xr.DataArray(direction, dims="angle")
    table["omega"] = ("angle", np.where(mirrored, 1 - there.omega, there.omega), there.omega.attrs)
    table["circle"] = ("angle", circles)
    return table.assign_attrs(barrier.attrs)


def _circle(quotients, tail_length, mirrored):
    """The text of a rotation number from its entries in the cube; "" if there is none."""
    from nasm.numbers import RotationNumber, moebius

    while quotients and quotients[-1] == 0:
        quotients.pop()
    if not quotients:
        return ""
    omega = RotationNumber(tuple(quotients[:-tail_length]), tuple(quotients[-tail_length:]))
    return str(moebius(omega, -1, 1) if mirrored else omega)


def ray_angles(n, tips):
    """n rays from 0 to 180 degrees, 45° and 135°, and `tips` more on each side of these two.

    They are spaced logarithmically, from 2 to 0.02 degrees away: the boundary has cusps there.
    """
    import numpy as np

    away = np.append(np.geomspace(2.0, 0.02, tips), 0.0)
    near = np.concatenate([[45 - away, 45 + away], [135 - away, 135 + away]]).ravel()
    return np.unique(np.concatenate([np.linspace(0, 180, n), near]).round(9))


tips_option = click.option(
    "--tips",
    default=8,
    show_default=True,
    type=click.IntRange(0, 1000),
    help="More rays on each side of the cusps at 45 and 135 degrees, spaced logarithmically.",
)


@click.command(context_settings=HELP)
@angles_option(181)
@tips_option
@click.option(
    "--tol",
    default=2e-5,
    show_default=True,
    type=click.FloatRange(1e-5, 0.1),
    help="Width of the bracket to aim at, in parts of the scale.",
)
@store_option
@cluster_options
def main(out, place, cluster, angles, tips, tol):
    """The last barrier on rays: a cube, a table and a figure in OUT.

    The defaults take about a minute and a half on two cores.
    """
    from pipeline.cubes import barrier

    rays = ray_angles(angles, tips)
    job = barrier.last_barrier(rays, tol)
    with session(out, cluster, [job], place) as client:
        table = unfolded(carry_out(client, place, job), rays)
        from workflows.figures.last_barrier import caption, draw_last_barrier
        from workflows.figures.style import save

        write_table(table, f"{out}/last_barrier.csv")
        figures = save(draw_last_barrier(table), out, "last_barrier", caption(table))
    click.echo(f"cube:   {place}/cubes.zarr, group barrier")
    click.echo(f"table:  {out}/last_barrier.csv")
    click.echo(f"figure: {', '.join(figures)}")


if __name__ == "__main__":
    main()
