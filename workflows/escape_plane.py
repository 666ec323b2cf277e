"""At which forcings does an ensemble escape, and when? First escape times over a plane of forcings.

The method is direct iteration (arXiv:1606.04824, Sec. V.B, Figs. 5 and 6). One field of first
escape times n*, in steps (periods of the forcing), contains the boundary of {n* ≤ N} for every
N ≤ n_max. Every cell is computed, or, with --levels above 1, a coarse grid is refined along the
boundary only.

Writes the cube `escape` and a figure to OUT. The paper's Fig. 5 is --first 0:1:512 --second 0:1:512
--levels 5 --n-max 1000000 --n-orbits 10000; Fig. 6 uses the same options with --first -1:1:1024.
"""

from workflows.shared.cli import command, plane_option, plane_options, sweeps


@command()
@plane_option
@plane_options(n_max=10_000, tile=16, levels=1, precision="double")
@sweeps
def main(run, **options):
    from workflows.figures.escape_plane import draw_escape_plane
    from workflows.shared.boundary_captions import describe_escape_field
    from workflows.shared.escape_field import escape_plane, estimate_tiles, grid_of

    grid = grid_of(**options)
    with run.sweeping(later=estimate_tiles(run, grid)):
        field = escape_plane(run, grid)
        run.figure(
            "escape_plane",
            draw_escape_plane,
            field,
            grid.drawn,
            caption=describe_escape_field(field),
        )
