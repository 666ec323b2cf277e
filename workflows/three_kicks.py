"""Where do the barriers of three kicks outlast those of two? The rotating map with Ω = 1/3.

The boundary of global transport of κ_n = κ̄ + Δκ cos 2π(φ0 + n/3) in the (κ̄, Δκ) plane, for several
phases φ0, against that of T_{κ1κ2}, which is Ω = 1/2 (arXiv:1606.04824, Sec. VII).

The boundary is the same for φ0 + 1/3, where the kicks start one later; for -φ0, where they come in
reverse; for φ0 + 1/2 and -Δκ; and for -κ̄ and -Δκ. So all phases are those from 0 to 1/12, with both
signs of Δκ; at 1/12 these are alike. Except at φ0 = 0 the kicks have no symmetry centre, and the
barrier is found by converse KAM on transversals, `nasm.transversals`.
"""

from fractions import Fraction

from workflows.parts.cli import command, parsed, ray_options, sweeps, whole

PHASES = ("0", "1/48", "1/24", "1/16", "1/12")


def parse_phases(texts):
    """Return the texts of fractions from 0 to below 1 in increasing order, no two equal."""
    phases = {}
    for text in texts:
        try:
            phase = Fraction(text)
        except (ValueError, ZeroDivisionError):
            phase = -1
        if not 0 <= phase < 1:
            raise ValueError(f"{text!r} must be a fraction from 0 to below 1, like 1/24")
        if phase in phases:
            raise ValueError(f"two phases are equal: {text} and {phases[phase]}")
        phases[phase] = text
    return [phases[phase] for phase in sorted(phases)]


@command()
@parsed(
    "--phase",
    PHASES,
    parse_phases,
    "FRACTION",
    "Phase φ0 of the forcing, in turns. May be repeated.",
    multiple=True,
)
@ray_options(61)
@whole("--n-max", 300, 30, 10**5, "Steps N of converse KAM; its bound is 0.7/N above the value.")
@sweeps
def main(run, phase, angles, tips, n_max):
    """Rotating standard maps with Ω = 1/3: cubes, a table and a figure in OUT.

    The defaults take some nine CPU minutes, about five minutes on two cores.
    """
    from nasm.planes import rotating
    from pipeline.cubes.barrier import last_barrier, unfolded
    from pipeline.cubes.breakdown import by_transversals
    from workflows.figures.three_kicks import draw_three_kicks
    from workflows.parts import rays

    around = rays.rotated_rays(angles, tips)
    last = last_barrier(rotating("1/2"), around, 1e-3)
    jobs = {text: by_transversals(rotating("1/3", text), around, n_max) for text in phase}
    with run.sweeping(last, *jobs.values()):
        two = unfolded(run.sweep(last).load(), around)
        three = rays.by_phase({text: run.sweep(job).load() for text, job in jobs.items()})
        three = rays.with_ratio(three, two.critical_scale, "two kicks")
        run.table("three_kicks", three)
        run.figure("three_kicks", *draw_three_kicks(three, two))


if __name__ == "__main__":
    main()
