"""How fast does each method converge, in its own measure of effort?

The paper's Fig. 7, on other rays too: the boundary {n* ≤ N} of direct iteration approaches the
breakup like N^(-1/η) (arXiv:1606.04824, Sec. V.B). Beside it the number M of orbits, converse KAM
in N, Greene's residue in the period q, and certified circles in the number n of grid points.

Three cubes, a table and two figures in OUT. About three minutes on two cores; ten times the steps
or orbits take ten times as long.
"""

from workflows.shared.cli import command, flag, increasing, sweeps, whole


@command()
@whole("--n-max", 1_000_000, 1000, 10**9, "Steps of direct iteration.")
@increasing("--n-orbits", "10,30,100,300,1000", 10**8, "Orbits of the nested ensembles.")
@flag("--quick", "At most 10 000 steps, and short runs of the others.")
@sweeps
def main(run, n_max, n_orbits, quick):
    from workflows.convergence import study as convergence
    from workflows.figures.convergence import draw_convergence, draw_diagonal
    from workflows.shared import direct

    n_max = min(n_max, 10_000) if quick else n_max
    best = convergence.breakups()
    scales = {angle: float(scale.value) for angle, scale in best.items()}
    job = direct.bias_job(scales, n_orbits, n_max)
    with run.sweeping(job, seconds=15 if quick else 100):  # of the other methods
        bias = direct.direct_bias(run.sweep(job).load(), direct.steps_up_to(n_max))
        others = convergence.other_methods(best, quick)
        run.keep("convergence", others, quick=quick)
        diagonal = convergence.on_the_diagonal(bias, scales[45.0])
        run.keep("convergence_diagonal", diagonal)
        run.table("convergence_direct", bias.to_dataset())
        run.figure("convergence", *draw_convergence(bias, others, convergence.exponents(bias)))
        run.figure("convergence_diagonal", *draw_diagonal(diagonal))
