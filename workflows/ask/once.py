"""The answer of `workflows.ask` for a finite sequence of kicks (aperiodic forcing)."""

import numpy as np

from nasm import escape
from nasm.converse_kam import aperiodic
from pipeline.sweep.progress import plural

_ORBITS, _STARTS = 256, 2000


def answer_aperiodic(kappa):
    """Return the results of converse KAM and direct iteration as text, and a drawing function."""
    survivor = aperiodic.last_survivor(kappa)
    lo, hi = escape.PAPER_WINDOW
    first = aperiodic.escape_time(kappa, 0.0, *escape.ensemble(_ORBITS), (lo, hi)).min()
    y = (np.arange(_STARTS) + 0.5) / _STARTS
    x = np.full(_STARTS, survivor.x)
    lifetimes = aperiodic.elimination_time(kappa, 0.0, survivor.site, x, y)

    def draw():
        from workflows.figures.ask import draw_once  # the import takes longer than the answer

        return draw_once(kappa, survivor, y, lifetimes)

    return "\n".join(_sentences(kappa, survivor, first)), draw


def _sentences(kappa, survivor, first):
    size, kick = kappa.size, survivor.site + 1
    lifetime = f"{plural(survivor.kicks, 'kick', 'g')} in either direction"
    strengths = f"of strengths from {kappa.min():.6g} to {kappa.max():.6g}"
    kicks = f"these {plural(size, 'kick')}, {strengths}"
    place = f"(x, y) = ({survivor.x:.6g}, {survivor.y:.9g}) before kick {kick}"
    if survivor.kicks <= aperiodic.HORIZON:
        ends = max(1, kick - int(survivor.kicks)), min(size, survivor.site + int(survivor.kicks))
        yield (
            f"NO BARRIER survives {kicks}: no curve around the cylinder remains the graph of a "
            "Lipschitz function through all of them."
        )
        yield (
            f"The longest-lived start, {place}, is eliminated by {lifetime}, kicks {ends[0]} to "
            f"{ends[1]}."
        )
        yield (
            "Evidence: on the line before that kick, converse KAM excludes a graph through each "
            "sampled start. This is strong evidence, not a proof; it does not exclude curves that "
            "fold."
        )
    elif survivor.kicks < np.inf:
        yield (
            f"UNDECIDED for {kicks}: all starts found are eliminated; the last of them, "
            f"{place}, is eliminated by {lifetime}. Beyond {aperiodic.HORIZON} kicks a search may "
            "miss starts with longer lifetimes."
        )
    else:
        yield (
            f"UNDECIDED for {kicks}: a barrier may survive them. The start {place} is not "
            "eliminated by any kicks in either direction, and every other line that was searched "
            "contains such a start."
        )
    lo, hi = escape.PAPER_WINDOW
    yield (
        f"Direct iteration: the first of {_ORBITS} orbits leaves {lo:g} < y < {hi:g} "
        f"by kick {first:g}."
        if first < np.inf
        else f"Direct iteration: none of {_ORBITS} orbits leaves {lo:g} < y < {hi:g}."
    )
