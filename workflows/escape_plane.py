"""At which forcings does an ensemble escape, and when? First escape times over the (κ1, κ2) plane.

Direct iteration of T_{κ1κ2} (arXiv:1606.04824, Sec. V.B, Figs. 5 and 6). One field of first escape
times n* holds the boundary {n* ≤ N} of every N ≤ n_max. The plane is computed in full, or, with
--levels above 1, coarsely at first and then finer only where one of the boundaries runs.
"""

import click

from workflows.cli import axis_option, cluster_options, finish, session


def plane_options(n_max, n_orbits, tile, levels):
    """The options of an escape-time plane, with the defaults of one workflow."""
    options = [
        click.option(
            "--n-max",
            default=n_max,
            show_default=True,
            type=click.IntRange(1, 10**12),
            help="Steps (of two kicks) after which an orbit counts as not escaping.",
        ),
        click.option(
            "--n-orbits",
            default=str(n_orbits),
            show_default=True,
            metavar="M[,M...]",
            callback=_parse_sizes,
            help="Orbits of an ensemble; several, increasing: nested ensembles, all recorded.",
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
    ]

    def decorate(function):
        for option in reversed(options):
            function = option(function)
        return function

    return decorate


def _parse_sizes(context, parameter, value):
    try:
        sizes = [int(size) for size in value.split(",")]
    except ValueError:
        sizes = [0]
    if sorted(set(sizes)) != sizes or not 1 <= sizes[0] <= sizes[-1] <= 10**8:
        raise click.BadParameter(
            f"{value!r} must be whole numbers from 1 to 10^8, increasing, e.g. 100,1000,10000"
        )
    return sizes


def boundaries_at(n_max):
    """The N whose boundaries are followed and drawn: n_max/10, n_max/2 and n_max, as in Fig. 5."""
    return sorted({max(1, n_max // 10), max(1, n_max // 2), n_max})


def escape_plane(client, out, kappa1, kappa2, n_max, n_orbits, tile, levels):
    """Compute the field of first escape times, refined where boundaries run; returns the Dataset.

    kappa1, kappa2 are the Axis of the finest level. Every level is a cube of its own,
    `escape_level0` and so on; `escape` is the composed field, with the `level` of each cell. With
    one level, `escape` is the cube itself. Ends the program if the sweep does not complete.
    """
    from nasm.escape import PAPER_WINDOW
    from pipeline import refine, schema, store, tasks
    from pipeline.grid import Axis
    from pipeline.sweep import sweep

    def level_cube(name, number):
        coarser = refine.FACTOR ** (levels - 1 - number)
        axes = [Axis(a.lo, a.hi, a.n // coarser) for a in (kappa1, kappa2)]
        return schema.escape_cube(name, *axes, n_orbits, n_max, PAPER_WINDOW, tile)

    def compute(cube, wanted):
        finish(sweep(client, out, cube, tasks.escape_tile, tasks.escape_cost, wanted))
        return store.read(out, cube.name).escape_time.values

    if levels == 1:
        compute(level_cube("escape", 0), None)
        return store.read(out, "escape")
    fields = []
    for number in range(levels):
        cube = level_cube(f"escape_level{number}", number)
        if number == 0:
            fields.append(compute(cube, None))
            continue
        # Finer cells may show that the boundary runs on in a neighbouring tile: follow it there.
        wanted, done = set(), set()
        cells = refine.next_level(_boundary_cells(refine.compose(fields)[0], n_max))
        while more := (refine.tiles_at(cells, tile) - done):
            wanted |= more
            fields[number:] = [compute(cube, wanted)]
            done |= more
            cells = _boundary_cells(refine.compose(fields)[0], n_max)
        if number == len(fields):  # no boundary in the plane
            fields.append(compute(cube, set()))
    field, level = refine.compose(fields)
    store.replace(out, schema.composed(level_cube("escape", levels - 1), field, level))
    return store.read(out, "escape")


def _boundary_cells(field, n_max):
    """Cells at a boundary of any ensemble and any N that is followed."""
    from pipeline.refine import boundary_cells

    return boundary_cells(
        (field[None] <= [[[[n]]] for n in boundaries_at(n_max)]).reshape(-1, *field.shape[-2:])
    )


def checked_levels(kappa1, kappa2, levels):
    """Refuse axes that cannot be halved levels - 1 times."""
    for name, axis in (("--kappa1", kappa1), ("--kappa2", kappa2)):
        if axis.n % 2 ** (levels - 1):
            raise click.BadParameter(
                f"{axis.n} cells cannot be halved {levels - 1} times; use a multiple of "
                f"{2 ** (levels - 1)}, or fewer --levels",
                param_hint=name,
            )


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@axis_option("--kappa1", "-1:1:256", "First kick's strength: lower end, upper end, cells.")
@axis_option("--kappa2", "0:1:128", "Second kick's strength, likewise.")
@plane_options(n_max=10_000, n_orbits=64, tile=16, levels=1)
@cluster_options
def main(out, cluster, kappa1, kappa2, n_max, n_orbits, tile, levels):
    """First escape times over the (κ1, κ2) plane, into OUT/cubes.zarr, group `escape`.

    The paper's Fig. 5 is --kappa1 0:1:512 --kappa2 0:1:512 --levels 5 --n-max 1000000
    --n-orbits 10000, and Fig. 6 the same with --kappa1 -1:1:1024.
    """
    checked_levels(kappa1, kappa2, levels)
    with session(out, cluster) as client:
        plane = escape_plane(client, out, kappa1, kappa2, n_max, n_orbits, tile, levels)
        from workflows.figures import draw_escape_plane, save

        figures = save(draw_escape_plane(plane, boundaries_at(n_max)), out, "escape_plane")
    click.echo(f"cube:   {out}/cubes.zarr, group escape")
    click.echo(f"figure: {', '.join(figures)}")


if __name__ == "__main__":
    main()
