"""Where do barriers under three kicks outlast those under two? The rotating map with Ω = 1/3.

Compares the boundary of this map in the (κ̄, Δκ) plane, for several phases φ0, with that of
T_{κ1κ2}, the case Ω = 1/2 (arXiv:1606.04824, Sec. VII). Boundaries are bracketed from both sides,
and the last circles are identified.

For Ω = 1/3 the boundary does not change under φ0 → φ0 + 1/3, which shifts the kicks by one; under
φ0 → -φ0, which reverses them; under (φ0, Δκ) → (φ0 + 1/2, -Δκ); and under (κ̄, Δκ) → (-κ̄, -Δκ). So
phases from 0 to 1/12 and both signs of Δκ cover all cases; at 1/12 both signs are equivalent. At
phases strictly between 0 and 1/12, the kicks have no symmetry centre.

Writes a cube for each phase and one for T, a table and a figure to OUT. The defaults take about
four CPU minutes.
"""

from workflows.shared import cli

PHASES = ("0", "1/24", "1/12")
MANY = ("0", "1/60", "1/30", "1/20", "1/15", "1/12")


def parse_phase(text):
    """Parse a phase, in turns, as a Fraction; reduce it to [0, 1)."""
    from nasm.checks import fraction

    return fraction("phase", text) % 1


@cli.command()
@cli.several("--phase", PHASES, parse_phase, "FRACTION", "Phase φ0 of the forcing, in turns.")
@cli.ray_options(31)
@cli.preset("--full", "In full, most of a CPU hour", n_rays=61, phase=MANY)
@cli.real("--tol", 1e-3, 1e-5, 0.1, "Target width of the bracket, relative to the scale.")
@cli.sweeps
def main(run, phase, n_rays, n_cusp_rays, tol):
    from nasm.planes import rotating
    from pipeline.cubes.barrier import cube_name, last_barrier, unfolded
    from workflows.figures.three_kicks import draw_three_kicks, three_kicks_caption
    from workflows.shared import rays

    around = rays.rotated_rays(n_rays, n_cusp_rays)
    planes = {text: rotating("1/3", text) for text in phase}
    last = last_barrier(rotating("1/2"), around, tol)
    jobs = {
        text: last_barrier(plane, around, tol, cube_name(plane)) for text, plane in planes.items()
    }
    with run.sweeping(last, *jobs.values()):
        two = unfolded(run.sweep(last).load(), around)
        kicks = {text: unfolded(run.sweep(job).load(), around) for text, job in jobs.items()}
        three = rays.with_ratio(rays.by_phase(kicks), two.critical_scale, "that of two kicks")
        three = rays.with_ratio(three, two.upper, "upper of two kicks", "ratio_lower", "lower")
        three = rays.with_ratio(three, two.lower, "lower of two kicks", "ratio_upper", "upper")
        run.table("three_kicks", three)
        caption = three_kicks_caption(three)
        run.figure("three_kicks", draw_three_kicks, three, two, caption=caption)
