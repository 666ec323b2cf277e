"""At which forcings does the circle of rotation number ω break? The boundaries CB_ω.

Along rays of a plane of forcings, for the paper's six rotation numbers (arXiv:1606.04824, Sec. VI,
Figs. 8 and 9) or any others, by two methods: the paper's, circles continued to their breakdown,
and Greene's residue, which is sharper and knows nothing of circles.
"""

from workflows.shared.cli import command, parsed, plane_option, ray_options, real, sweeps, whole


def parse_omegas(texts):
    """Return the RotationNumbers in increasing order; ValueError for rational or equal ones."""
    from nasm.numbers import NAMES, RotationNumber, parse

    omegas = {text: parse(text) for text in texts or NAMES}
    for text, omega in omegas.items():
        if omega.is_rational:
            raise ValueError(
                f"{text} is rational, and has no invariant circle that could break; write an "
                f"irrational number with a periodic continued fraction, like "
                f"{RotationNumber(omega.prefix, (1,))}"
            )
    if len(set(map(float, omegas.values()))) < len(texts or NAMES):
        raise ValueError("two rotation numbers are equal, or equal as floats")
    return sorted(omegas.values(), key=float)


@command()
@parsed(
    "--omega",
    None,
    parse_omegas,
    "OMEGA",
    "Irrational rotation number, 2gamma+1 or [1;4,(1)]; may be repeated.  "
    "[default: the paper's six]",
    multiple=True,
)
@plane_option
@ray_options(361)
@real("--tol", 1e-4, 1e-7, 0.1, "Error of the continuation to aim at.")
@whole("--q-max", 6000, 10, 10**6, "Longest period of the orbits of the residue method.")
@sweeps
def main(run, omega, plane, angles, tips, tol, q_max):
    """The boundaries CB_ω of circles: three cubes, two tables and two figures in OUT.

    The defaults take a minute and a half on two cores.
    """
    from nasm.planes import two_kicks
    from pipeline.cubes import breakdown
    from pipeline.cubes.barrier import last_barrier, unfolded
    from workflows.figures.circle_boundaries import draw_circle_boundaries, draw_tips
    from workflows.shared import rays

    angles = rays.ray_angles(plane, angles, tips)
    wanted = (
        breakdown.by_continuation(plane, omega, angles, tol),
        breakdown.by_residue(plane, omega, angles, q_max),
        last_barrier(plane, angles, 1e-3),
    )
    with run.sweeping(*wanted):
        circles, residues, barrier = map(run.sweep, wanted)
        barrier = unfolded(barrier, angles)
        run.table("circle_boundaries", circles)
        run.table("circle_boundaries_residue", residues)
        run.figure("circle_boundaries", *draw_circle_boundaries(circles, residues, barrier))
        if plane == two_kicks():
            run.figure("tips", *draw_tips(residues, circles, barrier))


if __name__ == "__main__":
    main()
