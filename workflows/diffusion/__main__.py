"""How fast is transport, once it is global? The diffusion of momentum, over the plane.

D(κ1, κ2) by ensembles, with errors; its limit for strong kicks, with the oscillation of Rechester &
White and the accelerator modes next to which there is no D; and its law just beyond CB_gt, against
the flux through what is left of the last circle.
"""

from workflows.shared.cli import command, flag, real, sweeps, whole


@command()
@real("--reach", 2.0, 1.0, 100.0, "Largest strength in the plane near the boundary.")
@whole("--cells", 64, 8, 4096, "Cells along each axis of both planes.")
@whole("--orbits", 512, 64, 10**6, "Orbits under each forcing; error ~ ORBITS^(-1/2).")
@whole("--n-max", 2**21, 2**13, 10**12, "Periods in the plane, and eight times as many on rays.")
@flag("--quick", "A preview: 24 cells, 256 orbits, 2^18 periods.")
@sweeps
def main(run, reach, cells, orbits, n_max, quick):
    """The diffusion coefficient of two kicks: five cubes, a table and a figure in OUT.

    The defaults take some five minutes on two cores, --quick one.
    """
    from nasm.planes import two_kicks
    from pipeline.cubes import diffusion
    from pipeline.cubes.barrier import last_barrier, unfolded
    from pipeline.cubes.flux import through_last_circle
    from pipeline.sweep.grid import Axis, joined
    from workflows.diffusion import study
    from workflows.figures.diffusion import draw_diffusion

    if quick:
        cells, orbits, n_max = min(cells, 24), min(orbits, 256), min(n_max, 2**18)
    angles, on_rays = study.wedge(quick), study.rays(quick)
    last = last_barrier(two_kicks(), angles, 1e-3)

    def jobs(scales, circles, known):
        yield through_last_circle(two_kicks(), scales, circles, study.excesses(1e-3), 30_000)
        yield diffusion.beyond("diffusion_rays", scales, study.excesses(), orbits, 8 * n_max)
        for name, end in (("diffusion", reach), ("diffusion_strong", study.STRONG)):
            yield joined(diffusion.over_plane(name, known, Axis(0.0, end, cells), orbits, n_max))

    later = jobs(*study.foreseen(on_rays))
    with run.sweeping(last, later=[(job, None) for job in later]):
        barrier = unfolded(run.sweep(last), angles).load()
        found = [run.sweep(job).load() for job in jobs(*study.known(barrier, on_rays))]
        law = study.law(barrier, *found[:2])
        planes = study.with_law(found[2], barrier, law), study.with_theory(found[3])
        run.table("diffusion", law)
        findings = study.findings(law, *planes)
        run.figure("diffusion", *draw_diffusion(*planes, law, barrier, findings))


if __name__ == "__main__":
    main()
