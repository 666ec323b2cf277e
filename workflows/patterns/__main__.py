"""When does transport begin under the kicks of laboratory experiments? Signs, pairs and bursts.

κ_n = s·profile_n for profiles of 1, -1 and 0, as in experiments with cold atoms: signs that flip
after every M kicks (arXiv:2202.02820) or for one kick in P; pairs of kicks a fraction ε of the
period apart, the 2δ-kicked rotor (arXiv:physics/0408088, physics/0703105); bursts of kicks.

Pairs, in units of their period: p' = p + K sin 2πx/2π, then x' = x + εp', and both again with 1 - ε
in place of ε. To first order in K they drive resonances at all integers p = k, as strong as those
of a standard map of strength 2K|cos πkε|, whose orbits of period one have R = K|cos πkε|/2. The
resonances near p = 1/(2ε), where the two kicks cancel, are the weakest. There the second-order term
in K, as ε → 0, is a kick of -K²ε/(4π) sin 4πx: a standard map in 2x and 2p of strength K²ε. So
circles there should break at √(κ_G/ε).

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
