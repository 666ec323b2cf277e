"""Between which forcings does the last barrier break, proved on both sides?

On each ray a circle is proved to exist at one forcing, and transport to be global at another one
beyond it; `nasm/proofs/README.md` has both theorems. Between the two nothing is proved. Further in,
a barrier is proved to exist on all of the ray.

Two cubes, a table and a figure in OUT, with the extra `proof`. The defaults take about eight CPU
minutes, for brackets 0.10 to 0.21% wide on four rays that were tried; with --cpu-seconds 8, in
some ten, each side is within 0.09% of the breakup on all 46.
"""

from workflows.shared.cli import command, preset, real, sweeps, whole


@command()
@whole("--n-rays", 361, 2, 10**5, "Rays around the plane; all but an eighth are mirror images.")
@real("--cpu-seconds", 3.0, 0.1, 10**5, "CPU seconds for a proof; there are three on a ray.")
@preset("--quick", "A preview", n_rays=41, cpu_seconds=0.5)
@sweeps
def main(run, n_rays, cpu_seconds):
    import numpy as np

    from nasm.planes import two_kicks
    from nasm.proofs.barrier import need_flint
    from pipeline.cubes.barrier import unfolded
    from pipeline.cubes.cube import untiled
    from pipeline.cubes.proved import proved_barrier
    from workflows.figures.proved_boundary import draw_proved_boundary, proved_boundary_caption

    need_flint()
    boundary = untiled("proved_boundary", n_rays=n_rays, cpu_seconds=cpu_seconds)
    angles = np.linspace(0, 360, n_rays)
    job = proved_barrier(two_kicks(), angles, cpu_seconds)
    with run.sweeping(job):
        swept = run.sweep(job)
        barrier = run.kept(boundary, lambda: unfolded(swept, angles))
        run.table("proved_boundary", barrier)
        caption = proved_boundary_caption(barrier)
        run.figure("proved_boundary", draw_proved_boundary, barrier, caption=caption)
