"""The page and the tables of `workflows.claims`."""

from collections import Counter

from pandas import DataFrame

from pipeline.sweep.progress import plural
from workflows.claims.envelope import HEADER, cells
from workflows.figures import files
from workflows.shared.judgement import WORST_FIRST, Verdict
from workflows.shared.page import render


def write(run, claims, errata, rows, sentences, command):
    """Write OUT/claims.html, its tables claims.csv and claims_*.csv, and the summary claims.txt.

    rows, sentences : as returned by `study.envelope`. command : the command line of the run. Claims
    that do not hold are also printed.
    """
    counts, shown = Counter(claim.verdict for claim in claims), sum(each.shown for each in errata)
    verdicts = ", ".join(f"{verdict.value}: {counts[verdict]}" for verdict in Verdict)
    summary = (
        f"{plural(len(claims), 'claim')} of the paper ({verdicts}); {shown} of {len(errata)} "
        "errata are confirmed numerically."
    )
    run.say(summary)
    for claim in claims:
        if claim.verdict is Verdict.FAILS:
            run.say(f"Does not hold ({claim.place}): {claim.statement}. Measured: {claim.value}.")
    render(
        "claims/page.html",
        run.path("pages", "claims.html"),
        claims=sorted(claims, key=lambda claim: WORST_FIRST.index(claim.verdict)),
        errata=errata,
        rows=map(cells, rows),
        sentences=sentences,
        command=command,
        summary=summary,
        header=[name.replace("gamma", "γ") for name in HEADER],
    )
    tables = {
        "claims": [{**vars(claim), "verdict": claim.verdict.value} for claim in claims],
        "claims_errata": [{**vars(erratum), "shown": erratum.shown} for erratum in errata],
        "claims_envelope": rows,
    }
    for name, table in tables.items():
        files.write(run.path("tables", f"{name}.csv"), DataFrame(table).to_csv(index=False))
    files.write(f"{run.out}/claims.txt", f"{summary}\n")
