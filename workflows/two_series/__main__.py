"""Two series of kicks: how does the threshold depend on the delay between them?

With time in units of the period, kicks of strength K act at integer times, and kicks of strength
K_α a time τ later (arXiv:2509.11593; for K_α = -K arXiv:physics/0408088): p' = p + K sin 2πx/2π,
then x' = x + τp', followed by that map with K_α and 1 - τ. For τ = a/q the forcing has q kicks, two
of them nonzero, and the map is periodic in p with period q. K_c(τ) is the strength K at which the
last barrier breaks, for K_α = K, K/2 and -K. Panels show the critical boundary CB_gt in the
(K, K_α) plane, coloured by the last circle, whose ω is the mean of p along it.

To first order, the kicks drive a resonance at every integer p = k. It is as strong as the resonance
of a standard map with strength abs(K + K_α e^{2πikτ}). So a barrier close to a weak resonance
should persist up to strong kicks, and the threshold should be lowest at the delay whose weakest
resonance is strongest.

If one series vanishes, the map is the standard map for any τ, so CB_gt meets the axes at κ_G,
the only number in the abstract of arXiv:2509.11593, whose authors obtain it with a neural network.
The abstract also says that the boundary is deformed systematically as τ increases; K_c is not
monotonic in τ.

The delays τ and 1 - τ are equivalent, by time reversal; so are (K, K_α), (K_α, K) and (-K, -K_α),
and (K, -K_α) if q is even.

`proved_map --plane pairs:1/3` proves, for forcings in such a plane, that transport is global or
that a barrier exists.

Writes cubes, two tables and two figures to OUT. The defaults take about four CPU minutes.
"""

from workflows.shared.cli import command, preset, real, several, sweeps, whole

DELAYS = "1/8", "1/5", "1/4", "1/3", "1/2"


def parse_delay(text):
    """Parse a delay, in periods, as a Fraction."""
    from nasm.checks import fraction
    from nasm.planes import pairs

    delay = fraction("delay", text)
    pairs(delay)  # raises if the delay is not between 0 and 1, or needs too many kicks
    return delay


@command()
@whole("--max-denominator", 8, 2, 64, "Largest q of the delays a/q at which K_c is computed.")
@several("--delay", DELAYS, parse_delay, "FRACTION", "Delay τ of a panel, in periods.")
@whole("--n-rays", 37, 2, 10**6, "Rays of each panel, from 0 to 180 degrees.")
@preset("--full", "In full, more than a CPU hour", max_denominator=16, n_rays=73)
@real("--tol", 1e-3, 1e-5, 0.1, "Target width of the bracket, relative to the scale.")
@sweeps
def main(run, max_denominator, delay, n_rays, tol):
    from nasm.planes import pairs
    from pipeline.cubes import barrier, forcings
    from pipeline.cubes.cube import untiled
    from workflows.figures import two_series as figures
    from workflows.shared import rays
    from workflows.shared.fractions import up_to_half
    from workflows.two_series import study

    delays = up_to_half(max_denominator)
    rows = study.forcings(delays)
    job = forcings.last_barriers("two_series_forcings", rows, study.PARAMETER, tol)
    planes = [pairs(each) for each in delay.values()]
    angles = rays.ray_angles(planes[0], n_rays, 0)
    around = [barrier.last_barrier(each, angles, tol, barrier.cube_name(each)) for each in planes]
    thresholds = untiled("two_series", max_denominator=max_denominator, tol=tol)
    with run.sweeping(job, *around):
        swept = run.sweep(job)
        table = run.kept(thresholds, lambda: study.thresholds(swept, delays), job.cube.name)
        run.table("two_series", table)
        run.figure("two_series", figures.draw_thresholds, table, caption=study.findings(table))
        curves = [barrier.unfolded(run.sweep(each).load(), angles) for each in around]
        run.table("two_series_planes", study.by_delay(map(str, delay.values()), curves))
        caption = figures.planes_caption(curves)
        run.figure("two_series_planes", figures.draw_planes, *curves, caption=caption)
