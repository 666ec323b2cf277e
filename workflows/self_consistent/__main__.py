"""Do barriers survive in a field that the particles make themselves? The paper's motivation.

In the self-consistent map (arXiv:1606.04824, Secs. I and II; arXiv:1601.00942) strength and phase
of the kicks are a mean field of the particles, and settle to something nearly periodic. Converse
KAM asks the recorded kicks for barriers, and the periodic forcing that is fitted to them. Beside it
a barrier that converse KAM cannot see, as it folds: the circle of a forcing that settles, pulled
back to its beginning.

Three cubes, a table and a figure in OUT. The defaults take about six CPU minutes, --quick one and
a half.
"""

from workflows.shared.cli import command, preset, real, whole, writes

_COUPLINGS = 0.2, 0.3, 0.4, *(x / 100 for x in range(45, 95, 5)), 1.0, 1.1, 1.2


@command()
@real("--coupling", _COUPLINGS, 0.01, 10, "Sum of the particles' weights; may be repeated.", True)
@whole("--n-particles", 65_536, 256, 10**7, "Particles, in a thin band around y = 0 at first.")
@whole("--n-max", 16_384, 4096, 10**6, "Kicks; barriers are sought in the second half of them.")
@preset("--quick", "A preview", n_particles=4096, n_max=8192)
@writes
def main(run, coupling, **size):
    from pipeline.cubes.cube import untiled
    from workflows.figures.self_consistent import draw_self_consistent, self_consistent_caption
    from workflows.self_consistent import study

    settings = {"couplings": sorted({*coupling}), **size}
    fields = untiled("self_consistent", **settings)
    verdicts = untiled("self_consistent_barriers", **settings)
    of_field = len(coupling) * (1.2e-8 * size["n_particles"] + 1.2e-4) * size["n_max"]
    of_verdicts = len(coupling) * 5e-4 * size["n_max"]
    with run.driving((fields, of_field), (verdicts, of_verdicts)):
        fields = run.kept(fields, lambda: study.fields(coupling, **size))
        verdicts = run.kept(verdicts, lambda: study.verdicts(fields))
        settling = run.kept(untiled("asymptotic_circle"), study.settling)
        run.table("self_consistent", verdicts.drop_dims("step"))
        found = fields, verdicts, settling
        caption = self_consistent_caption(*found)
        run.figure("self_consistent", draw_self_consistent, *found, caption=caption)
