"""Reference values for testing codes that trace field lines, iterate maps or track particles.

The critical strength κ_G, last barriers under two and three kicks, residues for thirty p/q,
rotation numbers to twelve digits, fluxes and turnstiles, diffusion coefficients, escape times and
their distribution, and lifetimes of barriers in ramps: each is computed by two independent methods
of this program, both named on the page. If the two results differ by more than the sum of their
errors, the value is reported as contradicted. If a few lines of plain Python can check a value,
they are printed beside it. `claims` judges statements of the paper; the values here are for testing
other codes, and the verdicts on them judge only this program.

Writes a cube, a page and reference.json to OUT. The defaults take about 80 CPU seconds; --quick
takes ten.
"""

from workflows.shared.cli import command, flag, writes


@command()
@flag("--quick", "A preview: fewer barriers, turnstiles and ramps, smaller ensembles.")
@writes
def main(run, quick):
    from pipeline.cubes.cube import untiled
    from workflows.reference import study
    from workflows.reference.writing import write

    cube = untiled("reference", quick=quick)
    with run.driving((cube, 10 if quick else 80), drawing=1):
        cube = run.kept(cube, lambda: study.measured(quick))
        write(run, study.entries(cube, quick), cube.attrs)
