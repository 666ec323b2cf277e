"""At which forcings does the circle of rotation number ω break? The boundaries CB_ω.

They are computed along rays of a plane of forcings, for the paper's six rotation numbers
(arXiv:1606.04824, Sec. VI, Figs. 8 and 9) or any others, by two independent methods: continuation
of circles from zero strength to their breakup, as in the paper, and Greene's residue, which is more
accurate and does not need to start at zero strength. Where continuation does not reach the
tolerance, the residue is used, and the two methods are not compared there.

Writes three cubes, two tables and two figures to OUT. The defaults take about one CPU minute.
"""

from workflows.shared.cli import command, plane_option, ray_options, real, several, sweeps, whole


def parse_omega(text):
    """Parse an irrational RotationNumber; raise ValueError if it is rational."""
    from nasm.numbers import RotationNumber, parse
    from nasm.texts import abbreviate

    omega = parse(text)
    if omega.is_rational:
        like = str(RotationNumber(omega.prefix, (1,)))
        raise ValueError(
            f"{abbreviate(text)} is rational, so no invariant circle has this rotation number; "
            "write an irrational number with a periodic continued fraction, like "
            f"{abbreviate(like)}"
        )
    return omega


_OMEGA = "Irrational rotation number, e.g. 2gamma+1 or [1;4,(1)]; by default the paper's six."
_TOL = "Target error; where continuation does not reach it, residues are used."


@command()
@several("--omega", None, parse_omega, "OMEGA", _OMEGA)
@plane_option
@ray_options(361)
@real("--tol", 1e-4, 1e-7, 0.1, _TOL)
@whole("--q-max", 6000, 10, 10**6, "Longest period of the orbits whose residues are used.")
@sweeps
def main(run, omega, plane, n_rays, n_cusp_rays, tol, q_max):
    from nasm.planes import two_kicks
    from pipeline.cubes import breakdown
    from pipeline.cubes.barrier import last_barrier, unfolded
    from workflows.figures import circle_boundaries as figures
    from workflows.shared import rays

    angles = rays.ray_angles(plane, n_rays, n_cusp_rays)
    omega = list(omega.values()) or rays.PAPER_CIRCLES
    folded = breakdown.folded(plane, omega, angles)
    # The first sweep loads the kernels for all sweeps.
    wanted = [last_barrier(plane, angles, 1e-3), breakdown.by_residue(plane, *folded, q_max)]
    if not any(plane.origin):
        wanted.append(breakdown.by_continuation(plane, *folded, tol, q_max))
    with run.sweeping(*wanted):
        barrier, *breakups = map(run.sweep, wanted)
        residues, *circles = (breakdown.unfolded(cube, omega, angles) for cube in breakups)
        circles = circles[0] if circles else residues
        barrier = unfolded(barrier, angles)
        run.table("circle_boundaries", circles)
        run.table("circle_boundaries_residue", residues)
        draw = figures.draw_circle_boundaries
        caption = figures.circle_boundaries_caption(circles, residues, barrier)
        run.figure("circle_boundaries", draw, circles, barrier, caption=caption)
        if plane == two_kicks():
            caption = figures.tips_caption(residues, circles)
            drawn = residues, circles, barrier
            run.figure("circle_boundaries_tips", figures.draw_tips, *drawn, caption=caption)
