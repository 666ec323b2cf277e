"""How far outside the true boundary does direct iteration put it? Figs. 5 and 6 of the paper.

On each ray the scale s_N beyond which some orbit of the ensemble leaves the window within N steps
(arXiv:1606.04824, Sec. V.B), against the breakup s_c of `last_barrier`. From s = 2·s_c inwards
first escape times are computed, thirty scales to a decade of s/s_c - 1, up to the first scale
without escape: escapes far out are quick, and no escape, which costs M·N orbit steps, is met once a
ray. The insets of Fig. 6 show how often one long orbit visits each part of the cell.

Three cubes, a table and two figures in OUT. The defaults take about three CPU minutes,
which grow like the steps and the orbits.
"""

from workflows.shared import cli


@cli.command()
@cli.increasing(
    "--n-max",
    "10000,50000,100000",
    10**9,
    "Numbers of steps N (periods of the forcing), increasing.",
)
@cli.whole("--n-orbits", 1000, 1, 10**8, "Orbits of the ensemble.")
@cli.plane_option
@cli.ray_options(181)
@cli.preset("--full", "In full, two CPU hours", n_max="100000,500000,1000000", n_orbits=10_000)
@cli.sweeps
def main(run, n_max, n_orbits, plane, n_rays, n_cusp_rays):
    from numpy import linspace

    from nasm.planes import two_kicks
    from pipeline.cubes.barrier import last_barrier, unfolded
    from pipeline.cubes.cube import untiled
    from workflows.figures import direct_boundary as figures
    from workflows.shared import direct, rays

    all_rays = rays.ray_angles(plane, n_rays, n_cusp_rays)
    spread = linspace(0, all_rays[-1], n_rays).round(9)  # it is too coarse for the cusps
    last = last_barrier(plane, all_rays, 1e-4)
    foreseen = direct.foreseen(plane, spread.tolist(), n_max[-1], n_orbits)
    insets = untiled("direct_insets")
    with run.sweeping(last, later=[foreseen], studies=[(insets, 10)]):
        barrier = unfolded(run.sweep(last), all_rays)
        known = barrier.sel(angle=spread).dropna("angle", subset=["critical_scale"])
        scales = known.critical_scale.to_series().to_dict()
        found = direct.inwards(run, direct.boundary_job(plane, scales, n_max[-1], n_orbits))
        boundary = direct.boundary_dataset(found, known, n_max)
        run.table("direct_boundary_rays", boundary)
        caption, of_rays = figures.rays_caption(boundary), (figures.draw_rays, boundary, barrier)
        if plane == two_kicks():
            insets = run.kept(insets, direct.insets_dataset)
            run.figure("direct_boundary_quadrant", *of_rays, caption=caption)
            half, caption = (boundary, barrier, insets), figures.half_plane_caption(insets)
            run.figure("direct_boundary", figures.draw_half_plane, *half, caption=caption)
        else:
            run.figure("direct_boundary", *of_rays, 360, caption=caption)
