"""The main job: where in the (κ1, κ2) plane does global transport begin, and what breaks there?

The figure combines three methods (arXiv:1606.04824, Secs. V and VI). First escape times are
computed over the plane; the boundary that they show converges from outside like N^(-1/3), where N
is the number of steps. The boundaries CB_ω of the paper's six circles are found by continuation, or
by Greene's residue where continuation does not reach the tolerance or rays do not start at zero.
CB_gt itself is bracketed by a certified circle (below) and converse KAM (above), and coloured by
the last circle to break.

Writes cubes, three tables and a figure to OUT. The defaults take about 50 CPU seconds. For direct
iteration at the size used in the paper, add --first -1.1:1.1:1024 --second 0:1.1:512 --levels 5
--n-max 1000000 --n-orbits 10000.
"""

import click

from workflows.shared.cli import command, plane_option, plane_options, ray_options, real, sweeps


@command()
@plane_option
# Cells at the last level are as wide as the scatter of the boundary on a ray, 1.2% of the scale.
@plane_options(n_max=100_000, tile=4, levels=3, precision="single")
@ray_options(181)
@real(
    "--tol", 1e-4, 1e-5, 0.1, "Target width of the bracket of CB_gt, and target error of the CB_ω."
)
@sweeps
def main(run, plane, n_rays, n_cusp_rays, tol, **options):
    from pipeline.cubes import breakdown
    from pipeline.cubes.barrier import last_barrier, unfolded
    from pipeline.cubes.cube import untiled
    from workflows.figures.circle_boundaries import describe_circles
    from workflows.figures.critical_boundary import draw_critical_boundary
    from workflows.shared import boundary_captions, rays
    from workflows.shared.escape_field import boundary_table, escape_plane, estimate_tiles, grid_of

    grid = grid_of(plane, **options)
    boundary = untiled("boundary", n_rays=n_rays, n_cusp_rays=n_cusp_rays, tol=tol, **plane.record)
    angles = rays.ray_angles(plane, n_rays, n_cusp_rays)
    folded = breakdown.folded(plane, rays.PAPER_CIRCLES, angles)
    if any(plane.origin):
        circle_job = breakdown.by_residue(plane, *folded, 1500)
    else:
        circle_job = breakdown.by_continuation(plane, *folded, tol)
    last_job = last_barrier(plane, angles, tol)
    with run.sweeping(last_job, circle_job, later=estimate_tiles(run, grid), drawing=12):
        swept = run.sweep(last_job)
        barrier = run.kept(boundary, lambda: unfolded(swept, angles))
        circles = breakdown.unfolded(run.sweep(circle_job), rays.PAPER_CIRCLES, angles)
        field = escape_plane(run, grid)
        direct = boundary_table(field, angles, grid.drawn)
        for n in direct.n.values[direct.critical_scale.isnull().all("angle")]:
            click.echo(f"no orbit escapes within {n} steps on any ray of this plane", err=True)
        run.table("critical_boundary", barrier)
        run.table("critical_boundary_circles", circles)
        run.table("critical_boundary_direct", direct)
        caption = boundary_captions.describe_boundary(barrier)
        caption += "\n" + boundary_captions.describe_direct_iteration(
            direct, barrier, grid.n_orbits[-1]
        )
        caption += "\n" + describe_circles(circles)
        results = field, circles, barrier
        run.figure("critical_boundary", draw_critical_boundary, *results, caption=caption)
