"""How fast does direct iteration converge? The paper's Fig. 7, on other rays too.

The boundary {n* ≤ N} approaches the breakup like N^(-1/η) (arXiv:1606.04824, Sec. V.B). Beside it
the number M of orbits. How the errors of the other methods fall is in the table of
`work_precision`.

Two cubes, a table and two figures in OUT. About two minutes on two cores; ten times the steps or
orbits take ten times as long.
"""

from workflows.shared.cli import command, increasing, preset, sweeps, whole

ANGLES = (0.0, 20.0, 40.0, 45.0)


@command()
@whole("--n-max", 1_000_000, 1000, 10**9, "Steps of direct iteration.")
@increasing("--n-orbits", "10,30,100,300,1000", 10**8, "Orbits of the nested ensembles.")
@preset("--quick", "A preview", n_max=10_000)
@sweeps
def main(run, n_max, n_orbits):
    from nasm import barriers
    from nasm.symmetries import ray
    from pipeline.cubes.cube import untiled
    from workflows.convergence.study import on_the_diagonal
    from workflows.figures import convergence as figures
    from workflows.shared import direct

    # Of the last barrier's breakup, to judge by.
    scales = {angle: float(barriers.critical_scale(ray(angle), 1e-3).value) for angle in ANGLES}
    job = direct.bias_job(scales, n_orbits, n_max)
    with run.sweeping(job):
        bias = direct.direct_bias(run.sweep(job).load(), direct.steps_up_to(n_max))
        n, largest = bias.n.values, bias.isel(ensemble=-1)
        fits = {angle: direct.exponent(n, largest.sel(angle=angle).values) for angle in ANGLES}
        diagonal = untiled("convergence_diagonal", n_max=n_max, ensembles=n_orbits)
        diagonal = run.kept(diagonal, lambda: on_the_diagonal(bias, scales[45.0]))
        run.table("convergence_direct", bias.to_dataset())
        caption = figures.convergence_caption(bias, fits)
        run.figure("convergence", figures.draw_convergence, bias, fits, caption=caption)
        caption = figures.diagonal_caption(diagonal)
        run.figure("convergence_diagonal", figures.draw_diagonal, diagonal, caption=caption)
