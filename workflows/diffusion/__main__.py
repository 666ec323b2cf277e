"""How fast is global transport? The diffusion of momentum beyond the boundary.

Ensembles of orbits yield the diffusion coefficient D(κ1, κ2) and its error on rays from CB_gt
outwards. Close to CB_gt, where ensembles are too slow, the flux ΔW through the cantorus of the last
circle is computed: if this cantorus were the only obstacle, D would be ΔW/m, where m is the number
of such cantori per unit of y, and D would vary like (s/s_c - 1)^3.01.

Writes three cubes, a table and a figure to OUT. The defaults take about six CPU minutes; --quick
takes one.
"""

from workflows.shared.cli import command, flag, sweeps, whole


@command()
@whole("--n-orbits", 256, 64, 10**6, "Orbits per forcing; the error is ∝ N_ORBITS^(-1/2).")
@whole("--n-max", 2**24, 2**13, 10**12, "Maximum number of steps (periods of the forcing).")
@flag("--quick", "A preview: 4 rays, at most 2^18 steps.")
@sweeps
def main(run, n_orbits, n_max, quick):
    import numpy as np

    from nasm.arithmetic.reproducible import geometric
    from nasm.planes import two_kicks
    from pipeline.cubes import beyond
    from pipeline.cubes.barrier import last_barrier, unfolded
    from workflows.diffusion import study
    from workflows.figures.diffusion import diffusion_caption, draw_diffusion

    n_max, plane = min(n_max, 2**18) if quick else n_max, two_kicks()
    angles = np.array([0.0, 12, 30, 45]) if quick else np.r_[0:45:2.0, 44.6, 45]
    excesses = geometric(0.05, 3.2, 8 if quick else 16)
    last = last_barrier(plane, angles, 1e-3)

    def jobs(scales, circles):
        yield beyond.flux(plane, scales, circles, [study.NEAREST, *excesses], 30_000)
        yield beyond.diffusion(scales, excesses, n_orbits, n_max)

    later = jobs(dict.fromkeys(angles, 0.6), dict.fromkeys(angles, "[0;(1)]"))
    with run.sweeping(last, later=[(job, None) for job in later]):
        known = unfolded(run.sweep(last), angles).load().dropna("angle", subset=["critical_scale"])
        scales, circles = (known[name].to_series() for name in ("critical_scale", "circle"))
        swept = (run.sweep(job).load() for job in jobs(scales.to_dict(), circles.to_dict()))
        law = study.law(known, *swept)
        run.table("diffusion", law)
        caption = diffusion_caption(law, study.findings(law))
        run.figure("diffusion", draw_diffusion, law, caption=caption)
