"""CB_gt as the envelope of the CB_ω: on which angles is which circle the last, and by how much?

Rays of the wedge 0° ≤ φ ≤ 45°, of which all others are images. CB_gt has a cusp at 45°, where the
last circles follow each other ever faster; rays come as near as a fraction of a degree, spaced
logarithmically. ω is in [0, 1] and stands for ±ω and all ω + 2n.
"""

import numpy as np

from nasm.numbers import NAMES, parse
from workflows.shared.rays import with_degenerate

HEADER = ("φ, degrees", "last circle, ω", "bracket, in parts", *NAMES)


def ranges(circles, barrier):
    """List the runs of rays with the same last circle, a dict each.

    from, to : angles of the first and the last ray of the run, degrees.
    circle : exact text of ω; "" where the methods left it open.
    bracket : the widest (upper - lower)/value; NaN if one is unknown.
    each of NAMES : by how much that circle of the paper's six breaks before CB_gt at least, in
        parts of CB_gt; NaN without a value.
    """
    wedge, short = _shortfalls(circles, barrier)
    table, names = short.transpose("angle", "circle").to_pandas(), wedge.circle.values
    table = table.set_axis(NAMES, axis=1).assign(circle=names).reset_index(names="from")
    table["to"] = table["from"]
    table["bracket"] = ((wedge.upper - wedge.lower) / wedge.critical_scale).values
    runs = np.cumsum(np.append(True, names[1:] != names[:-1]))
    how = {"from": "first", "to": "last", "circle": "first"}
    how |= {"bracket": lambda widths: widths.max(skipna=False), **dict.fromkeys(NAMES, "min")}
    return table.groupby(runs).agg(how).to_dict("records")


def _shortfalls(circles, barrier):
    """Return CB_gt in the wedge, and by how much each of the six breaks before it."""
    wedge = barrier.sel(angle=slice(0, 45))
    six = circles.critical_scale.sel(circle=[str(parse(name)) for name in NAMES])
    here = six.sel(angle=wedge.angle.values, method="nearest")
    return wedge, 1 - here / wedge.critical_scale.values


def cells(row):
    """Return the texts of the cells of a row of `ranges`."""
    ends = dict.fromkeys(f"{row[end]:.6g}" for end in ("from", "to"))
    return (
        " – ".join(ends),
        with_degenerate(row["circle"], row["from"]) if row["circle"] else "open",
        _text(row["bracket"], "{:.0e}"),
        *(_text(row[name], "{:.3%}") for name in NAMES),
    )


def _text(value, form):
    return form.format(round(value, 12) + 0.0) if np.isfinite(value) else "–"  # no -0


def summary(circles, barrier, rows):
    """Say in sentences what the table shows."""
    wedge, short = _shortfalls(circles, barrier)
    short = short.min("circle").values
    worst = int(np.nanargmax(short))
    theirs = [row for row in rows if min(row[name] for name in NAMES) < 1e-8]
    tip = [row["circle"] for row in rows if row["from"] >= 40 and row["circle"]]
    cascade = list(dict.fromkeys(tip))
    return [
        f"On {wedge.angle.size} rays there are {len(rows)} ranges and "
        f"{len({row['circle'] for row in rows if row['circle']})} different last circles. "
        f"One of the paper's six is the last on {len(theirs)} of the ranges. The best of them "
        f"falls short of CB_gt by {short[worst]:.3%} at φ = {wedge.angle.values[worst]:.6g}°, "
        f"where the last circle is {wedge.circle.values[worst]}; on the average over the rays, by "
        f"{np.nanmean(short):.3%}.",
        f"Towards the cusp at 45° the last circles are, from 40° on: {', '.join(cascade)}.",
    ]
