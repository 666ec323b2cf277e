"""At which strength does transport begin in experiments? Sign patterns, pairs, bursts of kicks.

κ_n = s·profile_n for profiles of 1, -1 and 0, as in experiments with cold atoms: signs that flip
after every M kicks (arXiv:2202.02820) or for one kick in P; pairs of kicks a fraction ε of the
period apart, the 2δ-kicked rotor (arXiv:physics/0408088, physics/0703105); bursts of kicks.

In units of the period, a pair of kicks is the map p' = p + K sin 2πx/2π, x' = x + εp', followed by
the same map with 1 - ε in place of ε. To first order in K, pairs drive resonances at all integers
p = k. These are as strong as in a standard map of strength 2K|cos πkε|, so their orbits of period
one have the residue R = K|cos πkε|/2. The resonances near p = 1/(2ε), where the two kicks cancel,
are the weakest. As ε → 0, the second-order term in K acts there as a kick -K²ε/(4π) sin 4πx, which
yields a standard map in 2x and 2p of strength K²ε. Circles there should therefore break at
K = √(κ_G/ε).

Writes a cube, a table and a figure to OUT. The defaults take about ten CPU minutes; --quick takes
one.
"""

from workflows.shared.cli import command, flag, real, sweeps


@command()
@flag("--quick", "A preview: fewer forcings.")
@real("--tol", 1e-2, 1e-5, 0.1, "Target width of the bracket, relative to the scale.")
@sweeps
def main(run, quick, tol):
    from pipeline.cubes import barrier, forcings
    from workflows.figures.patterns import draw_patterns
    from workflows.patterns import study

    job = forcings.last_barriers("patterns", study.patterns(quick), study.PARAMETER, tol)
    with run.sweeping(job):
        cube = barrier.with_circles(run.sweep(job))
        run.table("patterns", cube.assign(per_period=cube.critical_scale * cube.period))  # K_c
        run.figure("patterns", draw_patterns, cube, caption=study.findings(cube))
