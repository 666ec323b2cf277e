"""How do barriers break in the rotating standard map, κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ)?

For T_{κ1κ2}, the case Ω = 1/2, the boundaries of circles, CB_gt, and the onset of transport by
direct iteration are computed in the (κ̄, Δκ) plane (arXiv:1606.04824, Sec. VII, Figs. 10 and 11).
The breakup of two-dimensional tori is estimated from the residues of long periodic orbits with
nearly the same rotation vectors. The command `tori` certifies tori, and shows where converse KAM
excludes them for every ω.

The first of the three vectors is the paper's, (1705/3136, 2631/3136). The other two are convergents
of 1/τ = 0.543689… and 1/τ + 1/τ² = 0.839286…, where τ is the tribonacci constant; 2631 may be a
misprint for 2632.

Writes four cubes, a table and two figures to OUT. The defaults take about two CPU minutes.
"""

from workflows.shared.cli import command, ray_options, sweeps, whole

VECTORS = ("1705/3136,2631/3136", "1705/3136,2632/3136", "927/1705,1431/1705")


@command()
@ray_options(181)
@whole("--n-max", 20_000, 64, 10**12, "Steps (periods of the forcing) of direct iteration.")
@whole("--n-orbits", 256, 1, 10**8, "Orbits of direct iteration.")
@sweeps
def main(run, n_rays, n_cusp_rays, n_max, n_orbits):
    from nasm.planes import rotating
    from pipeline.cubes import breakdown, rotating_maps
    from pipeline.cubes.barrier import last_barrier, unfolded
    from workflows.figures import rotating as figures
    from workflows.shared import rays

    around, plane = rays.rotated_rays(n_rays, n_cusp_rays), rotating("1/2")
    wanted = (
        breakdown.by_residue(plane, rays.PAPER_CIRCLES, around, q_max=6000),
        last_barrier(plane, around, 2e-4),
        breakdown.by_escape(plane, around, n_max, n_orbits),
        rotating_maps.residues(VECTORS, around),
    )
    with run.sweeping(*wanted):
        circles, barrier, direct, tori = (run.sweep(job).load() for job in wanted)
        two = unfolded(barrier, around)
        tori = rays.with_ratio(tori, two.critical_scale, "CB_gt of T")
        tori = rays.with_ratio(tori, direct.upper, "the onset of transport of T", "ratio_direct")
        run.table("rotating_tori", tori)
        results = circles, two, direct
        caption = figures.rotating_circles_caption(*results)
        run.figure("rotating_circles", figures.draw_rotating_circles, *results, caption=caption)
        results, caption = (tori, two, direct), figures.rotating_tori_caption(tori, two, direct)
        run.figure("rotating_tori", figures.draw_rotating_tori, *results, caption=caption)
