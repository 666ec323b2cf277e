"""Run commands with small settings: `every_command.py OUT COMMAND,COMMAND,… RUNS [HIDDEN ...]`.

RUNS is the number of times each command runs, in the same folder; after the first run, functions
that compute raise an error. HIDDEN lists packages that cannot be imported, as if an extra were not
installed. The script prints a JSON object {command: [exit code, what it printed, whether it tried
to import python-flint, faults in its figures, drawn for the screen and for a journal column]}, for
the last run of each command, or for the run that failed. All sweeps share one worker, which has
two threads in this process. Unless Bokeh is hidden, the explorer runs until it is stopped.
"""

import json
import shlex
import sys
from contextlib import nullcontext
from importlib import import_module
from itertools import product
from pathlib import Path

import pytest
from sketches import sketches

PLANE = "--first 0:1.1:8 --second 0:1.1:8 --n-max 100 --n-orbits 4"
RAYS = "--n-rays 2 --n-cusp-rays 0"
SMALLEST = {
    "circle_boundaries": f"{RAYS} --tol 0.1 --q-max 100 --omega gamma --omega 2gamma",
    "claims": "--n-rays 3 --n-cusp-rays 0 --n-image-rays 1 --tol 0.01 --n-max 10000 --n-orbits 10",
    "convergence": "--quick --n-max 1000 --n-orbits 10",
    "critical_boundary": f"{PLANE} --levels 2 --tile 2 --n-rays 3 --n-cusp-rays 0 --tol 0.1",
    "diffusion": "--quick --n-max 8192",
    "direct_boundary": "--n-max 100 --n-orbits 4 --n-rays 19 --n-cusp-rays 0",
    "escape_plane": PLANE,
    "flux": "--angle 0 --least-excess 0.1 --q-max 100",
    "frequencies": "--max-denominator 2 --n-phases 2 --frequency 1/3 --frequency 0.4142135623731"
    " --tol 0.1",
    "frequency_map": "0.3 0.2 --position 0:1:8 --momentum 0:1:8 --n-max 100",
    "gallery": "--exhibit period_one",
    "last_barrier": f"{RAYS} --tol 0.1",
    "patterns": "--quick --tol 0.1",
    "period_one": "--primary -4:4:20 --secondary 0:8:10",
    "portraits": "--n-orbits 2 --n-max 10",
    "ramp": "--quick",
    "reference": "--quick",
    "ripple_spectrum": "--max-denominator 2 --frequency 1/3 --depth 0.3 --tol 0.1 --n-predicted 4",
    "rotating": "--n-rays 2 --n-cusp-rays 0 --n-max 64 --n-orbits 4",
    "self_consistent": "--coupling 0.5 --n-particles 256 --n-max 4096",
    "snapshot_tori": "--quick",
    "stability": "--quick",
    "three_kicks": "--n-rays 2 --n-cusp-rays 0 --tol 0.1 --phase 0",
    "tolerance": "--quick --n-forcings 10 --n-climbs 2",
    "two_series": "--max-denominator 2 --delay 1/2 --delay 1/3 --n-rays 3 --tol 0.1",
    "tori": "--quick --vector 0.6180339887498949 0.2700907567377265 --n-rays 2",
    "status": "",
    "verify": "",
    "explore": "--no-browser",
    # Commands that make proofs come last: the others must succeed without importing python-flint.
    "ask": "0.3 0.2 --prove",
    "labels": "--n-rays 3 --margins 0.05,0.3 --n-max 100 --n-orbits 8 --n-starts 8 --cells 32"
    " --cpu-seconds 0.001 --distance 0.5",
    "proved_boundary": "--n-rays 2 --cpu-seconds 0.1",
    "proved_map": "--cells 32 --cpu-seconds 0.001 --distance 0.5",
    "work_precision": "--method barriers --method barrier-proof --ray 45",
}
AGAIN = [name for name in SMALLEST if name not in ("ask", "explore")]  # these two store no cubes
# To plan their sweeps, these commands compute rays for a second or two.
PLANNING = "claims", "convergence", "labels", "proved_map"
COMPUTING = {
    "pipeline.store": ["replace"],
    "pipeline.sweep.sweep": ["_Run"],
    "nasm.circles.continuation": ["critical_scale"],
    "nasm.converse_kam.aperiodic": ["escape_time", "longest_lived"],
    "nasm.converse_kam.symmetry_line": ["longest_lived"],
    "nasm.escape": ["first_escape"],
    "nasm.orbits": ["orbit", "portrait"],
    "nasm.periodic": ["critical_scale", "residue"],
    "nasm.tori": ["critical_scale", "invariant_torus"],
}
PROVING = ("ask", "labels", "proved_boundary", "proved_map", "work_precision")


class Hidden:
    """A module finder that hides some packages, and records all packages that were searched for."""

    def __init__(self, packages):
        self.packages, self.asked = packages, set()

    def find_spec(self, name, path=None, target=None):
        self.asked.add(name.partition(".")[0])
        if name.partition(".")[0] in self.packages:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def compute_nothing(patch, may_plan):
    """Make all functions of COMPUTING raise an error, except those of `nasm` if `may_plan`."""

    def refuse(*_, **__):
        raise AssertionError("recomputes a stored result")

    for module, names in COMPUTING.items():
        for name in () if may_plan and module.startswith("nasm") else names:
            patch.setattr(import_module(module), name, refuse)


def look_at_figures(patch):
    """Have each figure drawn for the screen and for a journal column; return the list of faults."""
    from figure_faults import faults

    from workflows.figures import style

    problems, save, drawn = [], style.save, style.drawn

    def looked_at(figure, out, name, *options):
        paths = save(figure, out, name, *options)
        kind = "in a column" if style.in_column() else "on the screen"
        problems.extend(f"{name} {kind}: {fault}" for fault in faults(figure))
        return paths

    def twice(draw, out, name, caption="", column=False):
        with sketches():
            drawn(draw, out, name, caption, not column)
        return drawn(draw, out, name, caption, column)

    patch.setattr(style, "save", looked_at)
    patch.setattr(style, "drawn", twice)
    return problems


def main(out, commands, runs, *hidden):
    sys.meta_path.insert(0, finder := Hidden(hidden))
    from commands import invoke
    from toy import workers_here

    from workflows.shared import proved_plane
    from workflows.shared.cli import main_of

    proved_plane._N_RAYS = 13  # no option changes this number
    output = {}
    with workers_here() as client:
        workers = ["--scheduler", client().scheduler.address]
        names = commands.split(",")
        for run, name in product(range(int(runs)), names):
            if run and (name not in AGAIN or output[name][0]):
                continue
            there = Path(out, {"status": "last_barrier", "verify": "last_barrier"}.get(name, name))
            sweeps = "scheduler" in [option.name for option in main_of(name).params]
            with pytest.MonkeyPatch.context() as patch, sketches() if run else nullcontext():
                if run:
                    compute_nothing(patch, name in PLANNING)
                else:
                    faults = look_at_figures(patch)
                result = invoke(name, there, *shlex.split(SMALLEST[name]), *workers * sweeps)
            printed = f"{result.output}{result.exception or ''}"
            asked, faults = output[name][2:] if run else ("flint" in finder.asked, faults)
            output[name] = result.exit_code, printed, asked, faults
            print(name, result.exit_code, file=sys.stderr, flush=True)
    print(json.dumps(output))


if __name__ == "__main__":
    main(*sys.argv[1:])
