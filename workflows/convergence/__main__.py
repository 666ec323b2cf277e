"""How fast does direct iteration converge, on any ray of forcings? The paper's Fig. 7.

Direct iteration with N steps finds transport only beyond the boundary {n* ≤ N}, where n* is the
first escape time of an ensemble of M orbits. The boundary approaches the breakup like N^(-1/η)
(arXiv:1606.04824, Sec. V.B). The figure also shows how it depends on M. The command
`work_precision` compares the other methods.

For a ray κ = s·profile of any period, write a plane FILE.json whose "first" is the profile, and use
--plane FILE.json --angle 0.

Writes a cube, a table and a figure to OUT, and for two kicks at 45 degrees a second cube and a
second figure. The defaults take about three CPU minutes; the time is proportional to the number of
steps and to the number of orbits.
"""

from workflows.shared.cli import command, increasing, plane_option, preset, real, sweeps, whole

ANGLES = (0.0, 20.0, 40.0, 45.0)


@command()
@plane_option
@real("--angle", ANGLES, 0, 360, "Angle of a ray in degrees; may be repeated.", multiple=True)
@whole("--n-max", 1_000_000, 1000, 10**9, "Steps (periods of the forcing) of direct iteration.")
@increasing("--n-orbits", "10,30,100,300,1000", 10**8, "Numbers of orbits in the nested ensembles.")
@preset("--quick", "A preview", n_max=10_000)
@sweeps
def main(run, plane, angle, n_max, n_orbits):
    from nasm.planes import two_kicks
    from pipeline.cubes.cube import untiled
    from workflows.convergence.study import breakups, on_the_diagonal
    from workflows.figures import convergence as figures
    from workflows.shared import direct_iteration

    scales = breakups(plane, sorted(set(angle)))
    job = direct_iteration.bias_job(plane, scales, n_orbits, n_max)
    with run.sweeping(job):
        bias = direct_iteration.direct_bias(
            run.sweep(job).load(), direct_iteration.steps_up_to(n_max)
        )
        n, largest = bias.n.values, bias.isel(ensemble=-1)
        fits = {
            angle: direct_iteration.exponent(n, largest.sel(angle=angle).values) for angle in scales
        }
        run.table("convergence_direct", bias.to_dataset())
        caption = figures.convergence_caption(bias, fits)
        run.figure("convergence", figures.draw_convergence, bias, fits, caption=caption)
        if plane == two_kicks() and 45.0 in scales:
            diagonal = untiled("convergence_diagonal", n_max=n_max, ensembles=n_orbits)
            diagonal = run.kept(diagonal, lambda: on_the_diagonal(bias, scales[45.0]))
            caption = figures.diagonal_caption(diagonal)
            run.figure("convergence_diagonal", figures.draw_diagonal, diagonal, caption=caption)
