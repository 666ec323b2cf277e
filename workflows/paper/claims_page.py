"""The page of the claims and its tables: what a reader sees of `workflows.claims`."""

import csv
from collections import Counter
from pathlib import Path

from workflows.page import code, formula, heading, page, paragraph, table
from workflows.paper.envelope import HEADER, cells
from workflows.paper.rules import Verdict

_COLOURS = {
    Verdict.HOLDS: "yes",
    Verdict.CAVEAT: "partly",
    Verdict.FAILS: "no",
    Verdict.UNDECIDED: "unknown",
}

_VERDICTS = (
    "Each verdict is computed from the value beside it, by a rule in the code: an equation holds "
    "if its sides differ by no more than rounding explains, a number if it is within the errors. A "
    "caveat means that the claim holds only in the sense that the note states. Equations are tried "
    "on random points, boundaries on rays: none of this is a proof. Commands run in a copy of the "
    "program."
)
_MISPRINTS = (
    "Misprints that need no measurement: before Eq. (exact), “both S_κ2 and S_κ2” for S_κ1 and "
    "S_κ2; in the definition of CB, CB_gc for CB_gt; at the end of Sec. V.A, ε_c for κ_G; in "
    "Algorithm 1 the steps are numbered 1, 3, 4, 5, 6, 7, 6, 7; before Eq. (stdsymmetry), the "
    "reference to the standard map is to Eq. (mapaut), not (stdmap); in the captions of Figs. 8 "
    "and 10, “four KAM tori” are six."
)
_ENVELOPE = (
    "“It is expected that the CB_gt is the convex hull of all the CB_ω” (Sec. VII). The claims "
    "above judge that as it stands, and read as “envelope”: that on each ray transport begins "
    "where the last circle breaks. Here, in the wedge 0° ≤ φ ≤ 45°, which circle that is; how wide "
    "the bracket is between its certificate and converse KAM, in parts of the scale; and how long "
    "before CB_gt each of the paper's six breaks, at the least over the range, with 0 where it is "
    "the last itself. ω is in [0, 1] and stands for ±ω and all ω + 2n: [0;1,3,(1)] for "
    "(5γ+6)/(4γ+5), [0;2,(1)] for γ+1, [0;1,3,(4)] for 2γ. Shorter ranges may lie between two rays."
)
_ERRATUM = ("place", "printed", "corrected", "printed_off", "corrected_off", "measured")


def claims_page(claims, errata, rows, sentences, command):
    """The document, a str; `rows` and `sentences` of `claims_envelope`, `command` that made it."""
    counts = Counter(claim.verdict for claim in claims)
    found = "; ".join(f"{v.value}, {counts[v]}" for v in Verdict if counts[v])
    shown = sum(erratum.shown for erratum in errata)
    return page(
        "The claims of “Global transport in a nonautonomous standard map”",
        paragraph(
            "Calleja, del-Castillo-Negrete, Martínez-del-Río and Olvera, arXiv:1606.04824. "
            "Sections and equation labels are those of its LaTeX source."
        ),
        paragraph(
            f"{len(claims)} claims: {found}. Errata shown by numbers: {shown} of {len(errata)}."
        ),
        paragraph(_VERDICTS),
        paragraph("Made by ", code(command), "."),
        heading("Claims"),
        table(
            [
                (
                    c.place,
                    formula(c.statement),
                    formula(c.value),
                    c.verdict.value,
                    formula(c.note),
                    code(c.command),
                )
                for c in claims
            ],
            ("Place", "The paper's claim", "Our value", "Verdict", "Note", "Command"),
            [_COLOURS[claim.verdict] for claim in claims],
        ),
        heading("Errata"),
        paragraph("Printed and corrected form, and by how much each fails. Measured in this run."),
        table(
            [
                (
                    e.place,
                    formula(e.printed),
                    formula(e.corrected),
                    f"{e.printed_off:.2g}",
                    f"{e.corrected_off:.1e}",
                    formula(e.measured),
                    "shown" if e.shown else "not shown",
                    code(e.command),
                )
                for e in errata
            ],
            (
                "Place",
                "As printed",
                "As it should read",
                "Printed form off by",
                "Corrected off by",
                "Measured",
                "Verdict",
                "Command",
            ),
            ["yes" if erratum.shown else "no" for erratum in errata],
        ),
        paragraph(formula(_MISPRINTS)),
        heading("The envelope"),
        paragraph(formula(_ENVELOPE)),
        *(paragraph(formula(sentence)) for sentence in sentences),
        table([cells(row) for row in rows], [h.replace("gamma", "γ") for h in HEADER]),
    )


def write_tables(out, claims, errata, rows):
    """claims.csv, errata.csv and envelope.csv in `out`; returns their paths."""
    tables = {
        "claims": (
            ("place", "statement", "value", "verdict", "note", "command"),
            [(c.place, c.statement, c.value, c.verdict.value, c.note, c.command) for c in claims],
        ),
        "errata": (
            (*_ERRATUM, "shown", "command"),
            [(*(getattr(e, field) for field in _ERRATUM), e.shown, e.command) for e in errata],
        ),
        "envelope": (
            ("from", "to", "circle", "bracket", *HEADER[3:]),
            [(r["from"], r["to"], r["circle"], r["bracket"], *r["short"].values()) for r in rows],
        ),
    }
    paths = [Path(out) / f"{name}.csv" for name in tables]
    for path, (header, lines) in zip(paths, tables.values(), strict=True):
        with path.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows([header, *lines])
    return paths
