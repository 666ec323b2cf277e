"""How often do simple indicators of transport err? Their scores against proved answers.

Forcings (κ1, κ2) are drawn at random at given distances from CB_gt, on both sides. For each of
them the correct answer, BARRIER or TRANSPORT, is a theorem: the forcing lies in a cell or a patch
of the proved map, or has its own proof (nasm/proofs/README.md); forcings without a proof are left
out. Four indicators answer the same question after N steps (periods of the forcing): an escape, the
weighted Birkhoff average, the finite-time Lyapunov exponent and the fast Lyapunov indicator. The
last three describe individual orbits: they answer BARRIER if some orbit that starts on a line
across all circles looks regular and rotational. Their thresholds are fitted on the split `train`;
false answers are counted on the split `test`. A forcing and its images under the symmetries of the
plane always belong to the same split.

Writes cubes, two tables and a figure to OUT; needs the extra `proof`. The proved map is
computed as in `proved_map`, with the same options; one that is already in OUT is reused. The
defaults take about eight CPU minutes; --quick takes one.
"""

from workflows.shared.cli import (
    command,
    increasing,
    parsed,
    preset,
    proof_options,
    sweeps,
    whole,
)


def parse_margins(text):
    """Parse the ends of the classes of margins: increasing numbers from 0.0003 to 0.5."""
    from nasm.texts import parse_float, short_repr

    ends = [parse_float(part) for part in text.split(",")]
    if len(ends) < 2 or sorted({*ends}) != ends or not 3e-4 <= ends[0] < ends[-1] <= 0.5:
        rule = "must be two or more increasing numbers from 0.0003 to 0.5, e.g. 0.003,0.03"
        raise ValueError(f"{short_repr(text)} {rule}")
    return ends


@command()
@whole("--n-rays", 60, 2, 10**5, "Rays; each has one forcing per class on each side of CB_gt.")
@parsed(
    *("--margins", "0.003,0.01,0.03,0.1,0.3", parse_margins, "M,M[,M...]"),
    "Ends of the classes of margins (relative distances from CB_gt).",
)
@increasing("--n-max", "300,3000,30000", 10**7, "Steps N after which the indicators answer.")
@whole("--n-orbits", 1024, 1, 10**6, "Orbits in the ensemble for the escape indicator.")
@whole("--n-starts", 64, 1, 10**6, "Starts on the line, for the other indicators.")
@whole("--seed", 1, 0, 10**9, "Seed of the random rays, margins and images.")
@proof_options(32)
@preset(
    *("--quick", "A preview"),
    n_rays=8,
    margins="0.01,0.03,0.1,0.3",
    n_max="300,3000",
    cells="64",
    distance=0.3,
)
@sweeps
def main(run, n_rays, margins, n_max, n_orbits, n_starts, seed, cells, cpu_seconds, distance):
    from nasm.planes import two_kicks
    from nasm.proofs.barrier import need_flint
    from pipeline.cubes.barrier import last_barrier, with_circles
    from pipeline.cubes.cube import untiled
    from pipeline.cubes.indicators import IndicatorSettings
    from workflows.figures.labels import draw_labels, labels_caption
    from workflows.labels import regions, scoring, study
    from workflows.shared.proved_plane import ProvedPlane

    need_flint()
    if n_max[0] < 4:
        raise ValueError(f"--n-max={n_max[0]} must be at least 4: two halves of two steps")
    sizes = IndicatorSettings(n_orbits, n_starts)
    plane = ProvedPlane(two_kicks(), int(cells), cpu_seconds, distance)
    rays = last_barrier(two_kicks(), study.angles(n_rays, seed), 1e-3, "labels_rays")
    later = [*plane.later(), *study.planned(n_rays, margins, n_max, sizes)]
    with run.sweeping(rays, plane.barriers, later=[(job, None) for job in later]):
        drawn = study.drawn(with_circles(run.sweep(rays)), margins, seed)
        *proved, _ = plane.swept(run)
        sources = regions.in_map(run.place, *proved, drawn)
        own, job = study.own_proofs(drawn, sources), study.indicators_of(drawn, n_max, sizes)
        if own is not None:
            run.sweep(own)
            sources |= regions.by_own_proofs(run.place, own, sources)
        values = run.sweep(job).load()
        parts = [each.cube.name for each in (own, job) if each is not None]
        options = {"n_rays": n_rays, "margins": margins, "seed": seed, "n_max": n_max}
        options |= {"n_orbits": n_orbits, "n_starts": n_starts}
        kept, scored = (untiled(name, **options) for name in ("labels", "labels_scores"))
        labels = run.kept(kept, lambda: study.labelled(drawn, sources, values), *parts)
        scores = run.kept(scored, lambda: scoring.scores(labels, margins), *parts)
        seconds = scoring.seconds(run.place, values, scores)
        run.table("labels", labels)
        run.table("labels_scores", scores.assign(seconds=seconds))
        caption = labels_caption(labels, scores, scoring.findings(scores, seconds))
        run.figure("labels", draw_labels, scores, seconds, caption=caption)
