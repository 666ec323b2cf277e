"""Rigorous lower and upper bounds on the onset of global transport, ray by ray.

On each ray a circle is proved to exist at one forcing, and transport is proved to be global at
another beyond it; `nasm/proofs/README.md` states both theorems. Between the two forcings nothing is
proved. A barrier is proved to exist everywhere on the ray up to a third forcing, closer to zero.

Writes two cubes, a table and a figure to OUT; needs the extra `proof`. The defaults take about
eight CPU minutes and yield brackets of 0.10 to 0.21% on four sample rays; with --cpu-seconds 8,
which takes about ten CPU minutes, both bounds are within 0.09% of the breakup on all 46 rays.
"""

from workflows.shared.cli import command, preset, real, sweeps, whole


@command()
@whole(
    "--n-rays",
    361,
    2,
    10**5,
    "Rays around the plane; an eighth of them are computed, the others are mirror images.",
)
@real("--cpu-seconds", 3.0, 0.1, 10**5, "CPU time limit per proof; each ray needs three proofs.")
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
