"""How exact must repeated kicks be? The price of a ripple, and whether constant kicks are the best.

κ_n = s(1 + d·f_n) with Σf = 0 and Σf² = P over a period of P kicks: by which part is the rms
strength of the last breakup below κ_G? By renormalisation (see `response`) the loss goes like
d^(ln δ/ln λ), times a function of ln d that repeats when the convergents meet the same phases of
the ripple again. The conjecture is that no forcing of the same rms strength holds a barrier longer
than constant kicks: random ones are tried, and climbs to better ones.

Cubes, tables and a figure in OUT. The defaults take about ten CPU minutes, --quick one.
"""

from workflows.shared.cli import command, flag, sweeps, whole


@command()
@whole("--n-forcings", 10_000, 10, 10**6, "Random forcings to try.")
@whole("--n-climbs", 1000, 2, 10**5, "Climbs to forcings that hold longer.")
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
    words, golden = "rms of the deviations, over the mean", study.golden()
    ripples = last_barriers("tolerance", study.ripples(quick), words, 3e-3)
    tried, words = study.forcings(n_forcings, n_climbs), f"{words}; the seed of a climb"
    bounds = against_constant("tolerance_random", tried, words, golden, tries=500)
    laws = untiled("tolerance_laws", quick=quick)
    with run.sweeping(ripples, bounds, studies=[(laws, 5 if quick else 100)]):
        cube = with_circles(run.sweep(ripples))
        kept = cube.critical_scale * cube.rms / golden  # of the rms strength, against κ_G
        cube = cube.assign(loss=1 - kept, loss_error=kept * cube.error / cube.critical_scale)
        tried, laws = run.sweep(bounds).load(), run.kept(laws, lambda: study.laws(cube))
        for name, table in {"": cube, "_laws": laws, "_random": tried}.items():
            run.table(f"tolerance{name}", table)
        found = cube, laws, tried
        run.figure("tolerance", draw_tolerance, *found, caption=study.found(*found))
