"""How much flux passes through the last circle after its breakup? ΔW and its power law.

Just beyond CB_gt a cantorus remains. The area that crosses it in one step (one period) is the
difference in action between minimax and minimizing orbits, and grows like (s/s_c - 1)^η with
η = 3.01. This is part of the outlook of arXiv:1606.04824, Sec. VII; the method is that of MacKay,
Meiss & Percival, Physica D 13 (1984) 55.

Writes two cubes, two tables and a figure to OUT. Relative distances beyond the breakup range up to
0.5. The defaults take about a CPU minute.
"""

from math import ceil, log10

from workflows.shared.cli import command, real, sweeps, whole


@command()
@real("--angle", (0, 20, 30, 40, 45), 0, 180, "A ray, in degrees; may be repeated.", multiple=True)
@real("--least-excess", 1e-4, 1e-5, 0.1, "Smallest distance beyond the breakup, relative to it.")
@whole("--q-max", 200_000, 100, 10**6, "Longest period of the orbits; at least 10/LEAST_EXCESS.")
@sweeps
def main(run, angle, least_excess, q_max):
    import numpy as np

    from nasm.arithmetic.reproducible import geometric
    from nasm.planes import two_kicks
    from pipeline.cubes import beyond
    from pipeline.cubes.barrier import last_barrier, unfolded
    from workflows.figures.flux import draw_flux, flux_caption
    from workflows.flux import study as flux

    if q_max * least_excess < 10:
        least = f"--least-excess {least_excess:g}; use {ceil(10 / least_excess)} or more"
        raise ValueError(f"--q-max {q_max} is too short for {least}")
    angles = np.unique(angle)
    excesses = geometric(
        least_excess, 0.5, 1 + int(8 * log10(0.5 / least_excess))
    )  # eight per decade
    last = last_barrier(two_kicks(), angles, 1e-3)

    def job(scales, circles):
        return beyond.flux(two_kicks(), scales, circles, excesses, q_max)

    alike = job(dict.fromkeys(angles, 1.0), dict.fromkeys(angles, "[0;(1)]"))
    with run.sweeping(last, later=[(alike, None)]):
        rays = unfolded(run.sweep(last), angles).to_dataframe()
        fluxes = run.sweep(job(rays.critical_scale.to_dict(), rays.circle.to_dict())).load()
        laws = flux.laws(fluxes)
        run.table("flux", fluxes)
        run.table("flux_law", laws)
        run.figure("flux", draw_flux, fluxes, laws, caption=flux_caption(fluxes, laws))
