"""How fast does direct iteration converge? The paper's Fig. 7, on other rays too.

The boundary {n* ≤ N} approaches the breakup like N^(-1/η) (arXiv:1606.04824, Sec. V.B). Beside it
the number M of orbits. How the errors of the other methods fall is in the table of
`work_precision`.

Two cubes, a table and two figures in OUT. About two minutes on two cores; ten times the steps or
orbits take ten times as long.
"""

from workflows.shared.cli import command, increasing, preset, sweeps, whole


@command()
@whole("--n-max", 1_000_000, 1000, 10**9, "Steps of direct iteration.")
@increasing("--n-orbits", "10,30,100,300,1000", 10**8, "Orbits of the nested ensembles.")
@preset("--quick", "A preview", n_max=10_000)
@sweeps
def main(run, n_max, n_orbits):
    from workflows.convergence import study as convergence
    from workflows.figures.convergence import draw_convergence, draw_diagonal
    from workflows.shared import direct

    scales = convergence.breakups()
    job = direct.bias_job(scales, n_orbits, n_max)
    with run.sweeping(job):
        bias = direct.direct_bias(run.sweep(job).load(), direct.steps_up_to(n_max))
        diagonal = convergence.on_the_diagonal(bias, scales[45.0])
        run.keep("convergence_diagonal", diagonal)
        run.table("convergence_direct", bias.to_dataset())
        run.figure("convergence", *draw_convergence(bias, convergence.exponents(bias)))
        run.figure("convergence_diagonal", *draw_diagonal(diagonal))
