"""Where does the last barrier to transport break, and which circle is it? CB_gt from both sides.

On each ray the critical scale is computed from Greene's residue, and is bracketed by a certified
circle (below) and converse KAM (above).

Writes two cubes, a table and a figure to OUT. The defaults take about a CPU minute.
"""

from workflows.shared.cli import command, plane_option, ray_options, real, sweeps


@command()
@plane_option
@ray_options(181)
@real("--tol", 2e-5, 1e-5, 0.1, "Target width of the bracket, relative to the scale.")
@sweeps
def main(run, plane, n_rays, n_cusp_rays, tol):
    from pipeline.cubes.barrier import last_barrier, unfolded
    from pipeline.cubes.cube import untiled
    from workflows.figures.last_barrier import draw_last_barrier
    from workflows.shared import boundary_captions, rays

    boundary = untiled("boundary", n_rays=n_rays, n_cusp_rays=n_cusp_rays, tol=tol, **plane.record)
    angles = rays.ray_angles(plane, n_rays, n_cusp_rays)
    job = last_barrier(plane, angles, tol)
    with run.sweeping(job):
        swept = run.sweep(job)
        barrier = run.kept(boundary, lambda: unfolded(swept, angles))
        run.table("last_barrier", barrier)
        caption = boundary_captions.describe_boundary(barrier)
        run.figure("last_barrier", draw_last_barrier, barrier, caption=caption)
