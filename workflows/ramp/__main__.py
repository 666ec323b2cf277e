"""How fast may the kicks grow, and how smooth must the forcing be, for a barrier to persist?

While circles exist, the barriers are families of invariant graphs, one before each kick. Converse
KAM for aperiodic forcing (`nasm.converse_kam.aperiodic`) excludes them: in a ramp κ_n = κ_G + r·n
through the breakup, and under forcings of decreasing smoothness, down to random ones. Converse KAM
does not exclude curves that fold; an orbit that crosses all circles excludes these, too. In a ramp,
graphs are predicted to be excluded after ~ r^-0.497 kicks. In slow ramps the exponent is below
0.497, because each kick preserves the area under a graph, whereas the area under the golden
circle decreases by 0.0073 per unit of κ. If the phases of the kicks follow this area, graphs
are excluded after ~ r^-(0.497 ± 0.002) kicks (21 rates from 10⁻² to 10⁻⁷).

Writes two cubes and a figure to OUT. The defaults take about a CPU minute; --quick takes ten
seconds.
"""

from workflows.shared.cli import command, flag, writes


@command()
@flag(
    "--quick", "A preview: growth rates down to 1e-4 per kick, not 1e-7; fewer ripples and kicks."
)
@writes
def main(run, quick):
    import numpy as np

    from pipeline.cubes.cube import untiled
    from workflows.figures.ramp import draw_ramp, ramp_caption
    from workflows.ramp import study

    rates = 10 ** -np.arange(2, 4.01 if quick else 7.01, 0.25)
    ripples, kicks = ([0.1, 0.2, 0.4], 3000) if quick else ([0.02, 0.05, 0.1, 0.2, 0.4], 12_000)
    ramp, irregular = untiled("ramp", quick=quick), untiled("irregular", quick=quick)
    seconds = 5 if quick else 30
    with run.driving((ramp, seconds), (irregular, seconds)):
        ramp = run.kept(ramp, lambda: study.ramps(rates))
        irregular = run.kept(irregular, lambda: study.irregular(ripples, kicks))
        caption = ramp_caption(irregular, study.findings(ramp, irregular))
        run.figure("ramp", draw_ramp, ramp, irregular, caption=caption)
