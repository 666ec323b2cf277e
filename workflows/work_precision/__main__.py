"""How much CPU time does each method need for a given accuracy? All methods on six rays.

The reference is Greene's residue with periods up to 30 000. Methods that compute circles or
residues need ω as input; `nasm.barriers` finds the ω of the last circle. Five rays have two kicks
per period; the sixth, with the three kicks (1, 0.7, 0.3), has no symmetry line. Times are CPU
seconds of one thread, medians of several runs; the first run, which compiles the kernels, is
measured separately. Single precision is used only in direct iteration, whose error is far above
rounding.

Writes a cube, two tables and a figure to OUT. The defaults take about 90 CPU seconds.
"""

import click

from workflows.shared.cli import choice, command, flag, writes

NAMES = ("direct", "direct-100", "direct-window", "direct-single", "cones", "birkhoff", "circle")
NAMES += ("continuation", "crossing", "residue", "barriers", "transport-proof", "barrier-proof")
RAYS = ("45", "0", "30", "40", "120", "three-kicks")
_ALL = "may be repeated.  [default: all]"


@command()
@flag("--full", "Include the largest effort of each method: 15 CPU minutes.")
@choice("--method", NAMES, NAMES, f"Method to measure; {_ALL}", True)
@choice("--ray", RAYS, RAYS, f"Ray, in degrees, or three-kicks; {_ALL}", True)
@writes
def main(run, full, method, ray):
    from nasm.proofs.barrier import need_flint
    from pipeline.cubes.cube import untiled
    from workflows.figures import files
    from workflows.figures.work_precision import draw_work_precision
    from workflows.work_precision.measure import fastest, measure, table

    only = tuple(dict.fromkeys(method))
    try:
        need_flint()
    except ImportError as error:
        only = tuple(name for name in only if name != "barrier-proof")
        click.echo(f"barrier-proof is left out: {error}", err=True)
    rays = list(dict.fromkeys(ray))
    data = untiled("work_precision", rays=rays, methods=list(only), full=full)
    with run.driving((data, len(only) * len(rays) * (15 if full else 1.5))):
        data = run.kept(data, lambda: measure(rays, only, not full, run.line.show))
        run.table("work_precision", data[["effort", "cpu_seconds", "error", "estimated_error"]])
        files.write(run.path("tables", "work_precision.md"), f"{table(data)}\n")
        run.figure("work_precision", draw_work_precision, data, caption=fastest(data))
        click.echo(f"{table(data)}\n")
