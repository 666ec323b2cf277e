"""Map of the forcings for which a barrier, or global transport, is proved.

Transport is proved in cells of a plane of forcings, by a quadtree that is refined along the
boundary; barriers are proved in triangles with a corner at the plane's origin.
`nasm/proofs/README.md` states the theorems. In open cells neither is proved. Images under the
symmetries of the plane are added.

Writes three cubes and a figure to OUT; needs the extra `proof`. The defaults take about twelve CPU
minutes. In other planes, choose larger cells and distances: `--plane pairs:1/3 --cells 32
--cpu-seconds 0.2 --distance 0.3` takes five CPU minutes. With three or more kicks per period,
transport is proved only where strong kicks are far enough apart.
"""

from workflows.shared.cli import command, plane_option, preset, proof_options, sweeps


@command()
@plane_option
@proof_options(8, 1024, 0.06, 0.025)
@preset("--full", "In full, about a CPU hour", cells="4096", cpu_seconds=0.2, distance=0.01)
@sweeps
def main(run, plane, cells, cpu_seconds, distance):
    from nasm.proofs.barrier import need_flint
    from pipeline.cubes.proved import everywhere
    from workflows.figures.proved_map import draw_proved_map, proved_map_caption
    from workflows.shared.proved_plane import ProvedPlane

    need_flint()
    proofs = ProvedPlane(plane, int(cells), cpu_seconds, distance)
    with run.sweeping(proofs.barriers, later=[(job, None) for job in proofs.later()]):
        cells_cube, triangles, barrier = proofs.swept(run)
        results = everywhere(cells_cube, barrier), triangles, barrier
        run.figure("proved_map", draw_proved_map, *results, caption=proved_map_caption(*results))
