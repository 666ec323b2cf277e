"""How uniform must kicks be? The cost of a ripple, and whether constant kicks are optimal.

κ_n = s(1 + d·f_n) with Σf = 0 and Σf² = P over a period of P kicks: by what fraction is the rms
strength at the last breakup below κ_G? Renormalisation (see `response`) predicts that
the loss scales like d^(ln δ/ln λ), times a periodic function of ln d. Conjecture: no forcing
preserves a barrier up to a larger rms strength than constant kicks do. This conjecture is tested
on random forcings, and by hill climbs towards larger thresholds.

Writes cubes, tables and a figure to OUT. The defaults take about ten CPU minutes; --quick takes
one.
"""

from workflows.shared.cli import command, flag, sweeps, whole


@command()
@whole("--n-forcings", 10_000, 10, 10**6, "Random forcings to try.")
@whole("--n-climbs", 1000, 2, 10**5, "Hill climbs to forcings with a larger threshold.")
@flag("--quick", "A preview: few forcings, climbs and ripples.")
@sweeps
def main(run, n_forcings, n_climbs, quick):
    from pipeline.cubes.barrier import with_circles
    from pipeline.cubes.cube import untiled
    from pipeline.cubes.forcings import against_constant, last_barriers
    from workflows.figures.tolerance import draw_tolerance
    from workflows.tolerance import study

    if quick:
        n_forcings, n_climbs = min(n_forcings, 400), min(n_climbs, 40)
    label, golden = "rms deviation over the mean", study.golden()
    ripples = last_barriers("tolerance", study.ripples(quick), label, 3e-3)
    forcings, label = study.forcings(n_forcings, n_climbs), f"{label}; the seed of a climb"
    bounds = against_constant("tolerance_random", forcings, label, golden, tries=500)
    laws = untiled("tolerance_laws", quick=quick)
    with run.sweeping(ripples, bounds, studies=[(laws, 5 if quick else 100)]):
        cube = with_circles(run.sweep(ripples))
        threshold = cube.critical_scale * cube.rms / golden  # rms strength relative to κ_G
        loss_error = threshold * cube.error / cube.critical_scale
        cube = cube.assign(loss=1 - threshold, loss_error=loss_error)
        tried, laws = run.sweep(bounds).load(), run.kept(laws, lambda: study.laws(cube))
        for name, table in {"": cube, "_laws": laws, "_random": tried}.items():
            run.table(f"tolerance{name}", table)
        results = cube, laws, tried
        run.figure("tolerance", draw_tolerance, *results, caption=study.findings(*results))
