"""Is transport global under this one forcing, or does a barrier stop it?

The verdict of `nasm.verdict` in sentences, and a phase portrait with its evidence: the invariant
circle, or an escaping orbit. An aperiodic forcing (--once) has no invariant circles; converse KAM
then tests whether a family of invariant graphs may persist.

KAPPA ... is one period of the forcing, up to 64 kicks: 0.3 0.2 0.25, or those of a file, $(cat
FILE). Strengths are dimensionless, -1e6 to 1e6, and may be negative: -0.69 0.525. Within a relative
distance of a few 10⁻⁵ from the boundary the answer is UNDECIDED; the exit code is 0 for all three
answers. One or two kicks take about two CPU seconds; the first run on a machine compiles the
kernels, twenty seconds more. The portrait is in OUT.
"""

import os
import re
from pathlib import Path
from zlib import crc32

import click

from nasm.texts import abbreviate, parse_float
from workflows.shared import cli


def numbers_in(content):
    """Return the numbers of a text file, with spaces, lines, or commas and spaces between them."""
    try:
        text = content.decode("utf-8-sig")  # with the mark of Windows' editors, or without
    except UnicodeDecodeError:
        raise ValueError("not a text in UTF-8, e.g. one in UTF-16; save it as UTF-8") from None
    for word in text.split():
        if re.search(r"\d,\d", word):
            cure = "may be one number or two; write one like 0.3, and two like 0 3"
            raise ValueError(f"{abbreviate(word)} {cure}")
    return [parse_float(word) for word in text.replace(",", " ").split()]


def parse_forcing(strengths, plane, once):
    """Return the strengths of the kicks, and their point in a plane, (Plane, (a, b)) or None.

    strengths : numbers of the command line; with `plane` the coordinates of a point in it; empty
    with `once`, the path of a file of numbers. ValueError for arguments that contradict each other.
    """
    from nasm import planes  # does not load kernels
    from nasm.maps import forcing

    if once:
        if strengths or plane:
            raise ValueError("--once FILE is the whole forcing; leave KAPPA and --plane out")
        try:
            return forcing(numbers_in(Path(once).read_bytes())), None
        except ValueError as error:
            raise ValueError(f"--once {once}: {error}") from None
    if plane is None:
        if not strengths:
            raise ValueError("KAPPA is missing: give one to 64 strengths, e.g. ask 0.3 0.5")
        kappa = forcing(strengths)
        return kappa, (planes.two_kicks(), strengths) if kappa.size == 2 else None
    if len(strengths) != 2:
        axes = " and ".join(plane.axes)
        raise ValueError(f"{len(strengths)} numbers; a point of {plane.name} has two, {axes}")
    return forcing(plane.forcing(*strengths)), (plane, strengths)


@cli.command(ignore_unknown_options=True)
@click.argument("kappa", type=cli.Strength(), nargs=-1)
@cli.point_option
@click.option("--once", type=cli.FILE, help="Text file with the kicks of an aperiodic forcing.")
@cli.flag("--prove", "Try to prove the answer, within 20 CPU seconds.")
@cli.column_option
@cli.quiet_option
@cli.directory("Directory of the figure.")
def main(kappa, plane, once, prove, column, quiet, out):
    try:
        strengths, point = parse_forcing(kappa, plane, once)
        if once and prove:
            raise ValueError("--prove needs a periodic forcing; nothing can be proved with --once")
        os.makedirs(out, exist_ok=True)
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    except OSError as error:
        raise click.UsageError(f"--out={out}: {error.strerror}; choose another directory") from None
    cli.announce_kernels(quiet)
    from workflows.ask.once import answer_aperiodic
    from workflows.ask.period import answer_periodic
    from workflows.shared.verdict_words import MAX_LISTED

    try:
        text, draw = (
            answer_aperiodic(strengths) if once else answer_periodic(strengths, point, prove)
        )
    except ValueError as error:
        raise click.UsageError(f"{error}. For an aperiodic forcing use --once FILE") from None
    click.echo(text)

    from workflows.figures.style import drawn

    parts = ["ask", plane.name] if plane else ["ask"]
    parts += [Path(once).stem] if once else map(str, kappa[:MAX_LISTED])
    parts += [f"{crc32(strengths):08x}"] if len(kappa) > MAX_LISTED else []  # of all of them
    paths, reason = drawn(draw, out, re.sub("[:/,]", "-", "_".join(parts)), text, column)
    if reason:
        raise click.ClickException(reason)
    click.echo(f"figures: {', '.join(paths)}")
