"""How far outside the true boundary does direct iteration put it? Figs. 5 and 6 of the paper.

On each ray, s_N is the smallest scale above which at least one orbit of the ensemble leaves the
window within N steps (periods of the forcing; arXiv:1606.04824, Sec. V.B). It is compared with the
breakup s_c of `last_barrier`. First escape times are computed from s = 2·s_c inwards, at thirty
scales per decade of s/s_c - 1, down to the first scale without escape; only at that scale does
every orbit take all N steps. The insets of Fig. 6 show how often one long orbit visits each part of
the unit cell.

Writes three cubes, a table and two figures to OUT, in about three CPU minutes by default; the time
is proportional to the number of steps and to the number of orbits.
"""

from workflows.shared import cli


@cli.command()
@cli.increasing(
    "--n-max",
    "10000,50000,100000",
    10**9,
    "Numbers of steps N (periods of the forcing), increasing.",
)
@cli.whole("--n-orbits", 1000, 1, 10**8, "Orbits in the ensemble.")
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
    from workflows.shared import direct_iteration, rays

    all_rays = rays.ray_angles(plane, n_rays, n_cusp_rays)
    spread = linspace(0, all_rays[-1], n_rays).round(9)  # too coarse to resolve the cusps
    last = last_barrier(plane, all_rays, 1e-4)
    foreseen = direct_iteration.estimate_tiles(plane, spread.tolist(), n_max[-1], n_orbits)
    insets = untiled("direct_insets")
    with run.sweeping(last, later=[foreseen], studies=[(insets, 15)]):
        barrier = unfolded(run.sweep(last), all_rays)
        known = barrier.sel(angle=spread).dropna("angle", subset=["critical_scale"])
        scales = known.critical_scale.to_series().to_dict()
        found = direct_iteration.sweep_inwards(
            run, direct_iteration.boundary_job(plane, scales, n_max[-1], n_orbits)
        )
        boundary = direct_iteration.boundary_dataset(found, known, n_max)
        run.table("direct_boundary_rays", boundary)
        caption, of_rays = figures.rays_caption(boundary), (figures.draw_rays, boundary, barrier)
        if plane == two_kicks():
            insets = run.kept(insets, direct_iteration.insets_dataset)
            run.figure("direct_boundary_quadrant", *of_rays, caption=caption)
            half, caption = (boundary, barrier, insets), figures.half_plane_caption(insets)
            run.figure("direct_boundary", figures.draw_half_plane, *half, caption=caption)
        else:
            run.figure("direct_boundary", *of_rays, 360, caption=caption)
