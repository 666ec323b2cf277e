"""CB_gt as the envelope of the CB_ω: the last circle at each angle, and how far others fall short.

The rays cover the fundamental domain 0° ≤ φ ≤ 45°; all other rays are their images. CB_gt has a
cusp at 45°, towards which the last circle changes ever more often. Near the cusp the rays are
spaced logarithmically, down to a fraction of a degree from it. ω in [0, 1] represents ±ω and all
ω + 2n.
"""

import numpy as np

from nasm.numbers import NAMES, parse
from workflows.shared.rays import with_degenerate

HEADER = ("φ, degrees", "last circle, ω", "relative bracket", *NAMES)


def ranges(circles, barrier):
    """List the ranges of rays with the same last circle, each range as a dict.

    from, to : angles of the first and the last ray in the range, degrees.
    circle : ω as exact text; "" where the methods do not identify it.
    bracket : the largest (upper - lower)/value; NaN if any is unknown.
    each of NAMES, the paper's six circles : smallest distance from its breakup to CB_gt, relative
        to CB_gt; NaN if no ray has a value.
    """
    domain, short = _shortfalls(circles, barrier)
    table, names = short.transpose("angle", "circle").to_pandas(), domain.circle.values
    table = table.set_axis(NAMES, axis=1).assign(circle=names).reset_index(names="from")
    table["to"] = table["from"]
    table["bracket"] = ((domain.upper - domain.lower) / domain.critical_scale).values
    runs = np.cumsum(np.append(True, names[1:] != names[:-1]))
    reductions = {"from": "first", "to": "last", "circle": "first"}
    reductions |= {"bracket": lambda widths: widths.max(skipna=False)}
    reductions |= dict.fromkeys(NAMES, "min")
    return table.groupby(runs).agg(reductions).to_dict("records")


def _shortfalls(circles, barrier):
    """Return CB_gt in the fundamental domain, and the fraction by which each CB_ω lies below it."""
    domain = barrier.sel(angle=slice(0, 45))
    six = circles.critical_scale.sel(circle=[str(parse(name)) for name in NAMES])
    six = six.sel(angle=domain.angle.values, method="nearest")
    return domain, 1 - six / domain.critical_scale.values


def cells(row):
    """Return the cells of a row from `ranges`, as text."""
    ends = dict.fromkeys(f"{row[end]:.6g}" for end in ("from", "to"))
    return (
        " – ".join(ends),
        with_degenerate(row["circle"], row["from"]) if row["circle"] else "unknown",
        _text(row["bracket"], "{:.0e}"),
        *(_text(row[name], "{:.3%}") for name in NAMES),
    )


def _text(value, form):
    return form.format(round(value, 12) + 0.0) if np.isfinite(value) else "–"  # avoid -0


def summary(circles, barrier, rows):
    """Summarize the table in sentences."""
    domain, short = _shortfalls(circles, barrier)
    short = short.min("circle").values
    worst = int(np.nanargmax(short))
    of_six = [row for row in rows if min(row[name] for name in NAMES) < 1e-8]
    cusp = [row["circle"] for row in rows if row["from"] >= 40 and row["circle"]]
    cascade = list(dict.fromkeys(cusp))
    return [
        f"On {domain.angle.size} rays there are {len(rows)} ranges and "
        f"{len({row['circle'] for row in rows if row['circle']})} different last circles. "
        f"In {len(of_six)} of the ranges the last circle is one of the paper's six. The best of "
        f"the six falls short of CB_gt by up to {short[worst]:.3%} (at "
        f"φ = {domain.angle.values[worst]:.6g}°, where the last circle is "
        f"{domain.circle.values[worst]}), and by {np.nanmean(short):.3%} on average over the rays.",
        f"From 40° towards the cusp at 45° the last circles are: {', '.join(cascade)}.",
    ]
