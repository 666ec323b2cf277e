"""Is transport global under this one forcing, or does a barrier stop it?

The verdict of `nasm.verdict` in plain sentences, and a phase portrait with what decides: the
circle, or an orbit that escapes. One forcing, no sweep. Kicks that come only once have no circles;
of these `nasm.converse_kam.sequence` tells whether a family of graphs may survive them.

KAPPA ... is one period of the forcing, up to 64 kicks: 0.3 0.2 0.25, or those of a file, $(cat
FILE). Strengths are dimensionless, -1e6 to 1e6, and may be negative: -0.69 0.525. The answer may be
UNDECIDED, within a few parts in 10^5 of the boundary; the exit code is 0 for all three. It takes
about two seconds with one or two kicks, and the first time on a machine twenty more to compile the
kernels. The portrait is in OUT.
"""

import os
import re
from functools import partial
from pathlib import Path
from zlib import crc32

import click

from pipeline.sweep.progress import plural
from workflows.shared import cli
from workflows.shared.verdict_words import SHOWN, name_of, sentences

_STARTS, _STEPS = 64, 10**6  # of direct iteration; it only illustrates
_POINTS = 2**20  # of orbits among which one is looked for that escapes
_NEAR = 0.96  # where the boundary is nearer, no orbit escapes: none did on 12 rays, 4% beyond
_TRACED = 5000  # steps of the longest-lived start that are drawn, at most


def escaping_orbit(kappa):
    """Return x, y of an orbit up to its escape from the paper's window, or None.

    The starts that escape first in one arithmetic are followed in another: chaos lets few of them
    do so at the same step, but of many some do soon.
    """
    import numpy as np

    from nasm import escape, orbits

    x, y = escape.ensemble(_STARTS)
    times = escape.escape_time(kappa, x, y, _STEPS)
    lo, hi = escape.PAPER_WINDOW
    n = 4 * times.min()
    if not np.isfinite(n):
        return None
    starts = np.argsort(times, kind="stable")[: max(4, int(_POINTS / n))]
    orbit = orbits.orbit(kappa, x[starts], y[starts], int(min(n, _STEPS)))
    escapes = np.argwhere((orbit[1] < lo) | (orbit[1] > hi))  # by steps
    if not escapes.size:
        return None
    steps, first = escapes[0]
    return tuple(values[: steps + 1, first] for values in orbit)


def forcing_asked(strengths, plane, once):
    """Return the strengths of the kicks, and where they are, (Plane, its two coordinates), or None.

    strengths : numbers of the command line, with `plane` the coordinates of a point in it; none
    with `once`, the path of a file of numbers. ValueError says what does not fit together.
    """
    from nasm import planes
    from nasm.maps import forcing

    if once:
        if strengths or plane:
            raise ValueError("--once FILE is the whole forcing; leave KAPPA and --plane out")
        text = Path(once).read_text(encoding="utf-8").replace(",", " ")
        try:
            return forcing(list(map(float, text.split()))), None
        except ValueError as error:
            raise ValueError(f"--once {once}: {error}") from None
    if plane is None:
        kappa = forcing(strengths)
        return kappa, (planes.two_kicks(), strengths) if kappa.size == 2 else None
    if len(strengths) != 2:
        axes = " and ".join(plane.axes)
        raise ValueError(f"{len(strengths)} numbers; a point of {plane.name} has two, {axes}")
    return forcing(plane.forcing(*strengths)), (plane, strengths)


def drawn(kappa, point, verdict, escaping):
    """Draw the portrait of the forcing; if transport is global, with the longest-lived start."""
    from nasm import barriers, orbits
    from nasm.verdict import Answer
    from workflows.figures.ask import draw_verdict  # loading it takes as long as the verdict
    from workflows.shared.phase_space import portrait

    longest, name = None, name_of(kappa, point)
    if verdict.answer is Answer.TRANSPORT:
        x, y, steps = barriers.remnant(kappa, int(min(max(1000, 2 * verdict.steps), _STEPS)))
        longest = (steps, *orbits.orbit(kappa, x, y, int(min(steps, _TRACED))))
    return draw_verdict(kappa, point, name, verdict, portrait(kappa), longest, escaping)


def direct_iteration(verdict, escaping):
    """Say what direct iteration shows: a list of lines, empty where it was not asked."""
    from nasm.verdict import Answer

    if escaping is not None:
        x, y = escaping[0][0], escaping[1][0]
        return [
            f"Direct iteration: the orbit from (x, y) = ({x:.6g}, {y:.6g}) arrives at "
            f"y = {escaping[1][-1]:.3g} after {plural(escaping[0].size - 1, 'step')}."
        ]
    if verdict.answer is not Answer.TRANSPORT:
        return []
    if verdict.boundary.value > _NEAR:
        return ["Direct iteration shows nothing: it is too slow this near the boundary."]
    return ["Direct iteration: no orbit was found that escapes; that shows nothing."]


def asked_of_period(point, prove, strengths):
    """Return the verdict on one period of kicks in words, and a function that draws its figure.

    point : (Plane, its two coordinates), or None. prove : bool. ValueError if the period is long.
    """
    from nasm.verdict import Answer, verdict

    found = verdict(strengths, prove)
    transport = found.answer is Answer.TRANSPORT
    far = not found.boundary.value > _NEAR  # NaN: not known to be near
    escaping = escaping_orbit(strengths) if transport and far else None
    text = sentences(strengths, point, found) + direct_iteration(found, escaping)
    return "\n".join(text), partial(drawn, strengths, point, found, escaping)


@cli.command(ignore_unknown_options=True)
@click.argument("kappa", type=float, nargs=-1)
@cli.point_option
@click.option("--once", type=cli.FILE, help="Text file of any kicks, which do not repeat.")
@cli.flag("--prove", "Prove the answer, as far as 20 s allow.")
@cli.flag("--pdf", "The figure as PDF too.")
@cli.draws
@cli.out_option
def main(kappa, plane, once, prove, pdf, out):
    try:
        strengths, point = forcing_asked(kappa, plane, once)
        if once and prove:
            raise ValueError("--prove needs kicks that repeat; nothing is proved with --once")
        os.makedirs(out, exist_ok=True)
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    except OSError as error:
        raise click.UsageError(f"--out={out}: {error.strerror}; choose another directory") from None
    cli.announce_kernels()
    if once:
        from workflows.ask.once import asked_once as asked_one
    else:
        asked_one = partial(asked_of_period, point, prove)
    try:
        text, draw = asked_one(strengths)
    except ValueError as error:
        raise click.UsageError(f"{error}. Kicks that come once go to --once FILE") from None
    click.echo(text)

    from workflows.figures.style import save

    asked = ["ask", plane.name] if plane else ["ask"]
    asked += [Path(once).stem] if once else map(str, kappa[:SHOWN])
    asked += [f"{crc32(strengths):08x}"] if len(kappa) > SHOWN else []  # of all of them
    name, kinds = re.sub("[:/,]", "-", "_".join(asked)), ("png", "pdf") if pdf else ("png",)
    try:
        click.echo(f"figures: {', '.join(save(draw(), out, name, text, kinds))}")
    except OSError as error:
        raise click.ClickException(f"--out={out}: {error.strerror}; no figure is kept") from None
