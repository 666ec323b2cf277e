"""At which forcings does an ensemble escape, and when? First escape times over the (κ1, κ2) plane.

Direct iteration of T_{κ1κ2} (arXiv:1606.04824, Sec. V.B, Figs. 5 and 6). One field of first escape
times n* holds the boundary {n* ≤ N} of every N ≤ n_max. The plane is computed in full, or, with
--levels above 1, coarsely at first and then finer only where a boundary runs.
"""

import functools
from dataclasses import dataclass, replace

import click

from workflows.cli import (
    HELP,
    axis_option,
    carry_out,
    cluster_options,
    integers_option,
    session,
    store_option,
)


@dataclass(frozen=True)
class Plane:
    """What to compute: axes and number of levels of the finest grid, ensembles, and steps.

    kappa1, kappa2 : grid.Axis. n_orbits : sizes of nested ensembles. follow : N of the boundaries
    {n* ≤ N} that the levels follow.
    """

    kappa1: object
    kappa2: object
    n_max: int
    n_orbits: list[int]
    tile: int
    levels: int
    follow: list[int]

    def __post_init__(self):
        for name, axis in (("--kappa1", self.kappa1), ("--kappa2", self.kappa2)):
            if axis.n % 2 ** (self.levels - 1):
                raise click.BadParameter(
                    f"{axis.n} cells cannot be halved {self.levels - 1} times; use a multiple of "
                    f"{2 ** (self.levels - 1)}, or fewer --levels",
                    param_hint=name,
                )
            if axis.n < 2**self.levels:
                raise click.BadParameter(
                    f"{axis.n} cells are too few; use at least {2**self.levels}, two at the "
                    "coarsest level",
                    param_hint=name,
                )
        if self.follow[-1] > self.n_max:
            raise click.BadParameter(
                f"N={self.follow[-1]} must be at most n-max={self.n_max}", param_hint="--follow"
            )

    @property
    def drawn(self):
        """N of the boundaries that are shown: those that are resolved everywhere.

        In a plane that is computed in full n_max/10, n_max/2 and n_max, as in Fig. 5.
        """
        if self.levels > 1:
            return self.follow
        return sorted({max(1, self.n_max // 10), max(1, self.n_max // 2), self.n_max})


def plane_options(kappa1, kappa2, n_max, n_orbits, tile, levels):
    """The options of an escape-time plane, with one workflow's defaults; passed on as `plane`."""
    options = [
        axis_option("--kappa1", kappa1, "First kick's strength: lower end, upper end, cells."),
        axis_option("--kappa2", kappa2, "Second kick's strength, likewise."),
        click.option(
            "--n-max",
            default=n_max,
            show_default=True,
            type=click.IntRange(1, 10**12),
            help="Steps (of two kicks) after which an orbit counts as not escaping.",
        ),
        integers_option(
            "--n-orbits",
            str(n_orbits),
            10**8,
            "Orbits of the ensemble; several, increasing: nested ensembles, all recorded.",
        ),
        click.option(
            "--tile",
            default=tile,
            show_default=True,
            type=click.IntRange(1, 4096),
            help="Cells along each side of a tile, the unit of work and of storage.",
        ),
        click.option(
            "--levels",
            default=levels,
            show_default=True,
            type=click.IntRange(1, 12),
            help="Levels of refinement up to the cells asked for; 1 computes every cell.",
        ),
        integers_option(
            "--follow",
            None,
            10**12,
            "Refine along, and draw, the boundaries {n* <= N} of these N.  [default: n-max]",
        ),
    ]

    def decorate(function):
        @functools.wraps(function)
        def wrapped(*args, kappa1, kappa2, n_max, n_orbits, tile, levels, follow, **kwargs):
            plane = Plane(kappa1, kappa2, n_max, n_orbits, tile, levels, follow or [n_max])
            return function(*args, plane=plane, **kwargs)

        for option in reversed(options):
            wrapped = option(wrapped)
        return wrapped

    return decorate


def planned(plane):
    """The job of the plane: all of it, or the cube as composed of its levels."""
    from pipeline.cubes import escape

    finest = _level_job(plane, "escape", plane.levels - 1)
    if plane.levels == 1:
        return finest
    return replace(finest, cube=escape.composed(finest.cube, plane.levels, plane.follow))


def _level_job(plane, name, level):
    from pipeline import refine
    from pipeline.cubes import escape

    axes = [
        axis.coarsened(refine.FACTOR ** (plane.levels - 1 - level))
        for axis in (plane.kappa1, plane.kappa2)
    ]
    return escape.plane(name, *axes, plane.n_orbits, plane.n_max, plane.tile)


def escape_plane(client, place, plane):
    """Compute the field of first escape times into the store in `place`; returns it as a Dataset.

    With one level, the cube `escape` holds every cell. With more, every level is a cube of its own,
    `escape_level0` and so on, and `escape` is composed of them, with the `level` of each cell. Ends
    the program if a sweep does not complete.
    """
    from pipeline import refine, store
    from pipeline.cubes import escape

    if plane.levels == 1:
        return carry_out(client, place, planned(plane))
    job = _level_job(plane, "escape_level0", 0)
    fields = [carry_out(client, place, job).escape_time.values]
    for level in range(1, plane.levels):
        job = _level_job(plane, f"escape_level{level}", level)
        wanted = refine.tiles_at(refine.halved(_followed_cells(fields, plane)), plane.tile)
        fields.append(carry_out(client, place, job, wanted).escape_time.values)
        # Finer cells may show that the boundary runs on in a neighbouring tile: follow it there.
        while more := refine.tiles_at(_followed_cells(fields, plane), plane.tile) - wanted:
            wanted |= more
            fields[-1] = carry_out(client, place, job, wanted).escape_time.values
    finest = _level_job(plane, "escape", plane.levels - 1).cube
    composed = escape.composed(finest, plane.levels, plane.follow, *refine.compose(fields))
    store.replace(place, composed)
    return store.read(place, "escape")


def _followed_cells(fields, plane):
    """Cells at the boundary {n* ≤ N} of any ensemble, for any N to be followed."""
    import numpy as np

    from pipeline.refine import boundary_cells, compose

    field, _ = compose(fields)
    return boundary_cells(np.concatenate([field <= n for n in plane.follow]))


@click.command(context_settings=HELP)
@plane_options("-1.1:1.1:256", "0:1.1:128", n_max=10_000, n_orbits=64, tile=16, levels=1)
@store_option
@cluster_options
def main(out, place, cluster, plane):
    """First escape times over the (κ1, κ2) plane, into OUT/cubes.zarr, group `escape`.

    The paper's Fig. 5 is --kappa1 0:1:512 --kappa2 0:1:512 --levels 5 --n-max 1000000
    --n-orbits 10000, and Fig. 6 the same with --kappa1 -1:1:1024.
    """
    with session(out, cluster, [planned(plane)], place) as client:
        dataset = escape_plane(client, place, plane)
        from workflows.figures.escape_plane import draw_escape_plane
        from workflows.figures.style import save

        figures = save(draw_escape_plane(dataset, plane.drawn), out, "escape_plane")
    click.echo(f"cube:   {place}/cubes.zarr, group escape")
    click.echo(f"figure: {', '.join(figures)}")


if __name__ == "__main__":
    main()
