"""Is transport global under this forcing, and at which multiple of it does the last barrier break?

Prints the verdict of `nasm.verdict` in sentences, and draws a phase portrait that shows the
evidence: the invariant circle, or an escaping orbit. An aperiodic forcing (--once) has no invariant
circles; converse KAM then tests whether a family of invariant graphs may persist.

KAPPA ... is one period of the forcing, first kick first: 0.3 0.2 0.25, or a text file of such
strengths. They are dimensionless, from -1e6 to 1e6: -0.69 0.525. A file with one forcing per line
yields a table of answers. With more than 64 kicks only transport is tested. The answer is BARRIER,
TRANSPORT or, within a relative distance of a few times 10⁻⁵ of the boundary, UNDECIDED; the exit
code is 0 for all three. One or two kicks take about two CPU seconds; the first run on a machine
also compiles the kernels, which takes half a minute more. The portrait, or the table, is written to
OUT.
"""

import json
import os
import re
from pathlib import Path
from zlib import crc32

import click

from workflows.shared import cli


def parse_forcing(strengths, plane, once):
    """Return the strengths of the kicks, and their point in a plane as (Plane, (a, b)), or None.

    strengths : numbers on the command line; with `plane`, the coordinates of a point in it; with
    `once`, empty. once : path of a file of numbers. Raises ValueError if arguments are missing
    or invalid, or contradict each other.
    """
    from nasm import planes  # does not load kernels
    from nasm.maps import forcing
    from workflows.shared.forcing_files import numbers_in

    if once:
        if strengths or plane:
            raise ValueError("--once FILE is the whole forcing; leave KAPPA and --plane out")
        try:
            return forcing(numbers_in(Path(once).read_bytes())), None
        except ValueError as error:
            raise ValueError(f"--once {once}: {error}") from None
    if plane is None:
        if not strengths:
            raise ValueError("KAPPA is missing: give the strengths of one period, e.g. ask 0.3 0.5")
        kappa = forcing(strengths)
        return kappa, (planes.two_kicks(), strengths) if kappa.size == 2 else None
    if len(strengths) != 2:
        axes = " and ".join(plane.axes)
        raise ValueError(f"coordinates: {len(strengths)}; a point in {plane.name} has two, {axes}")
    return forcing(plane.forcing(*strengths)), (plane, strengths)


def _answer_as_data(forcings, is_table, prove, as_json, quiet, out):
    """Print the verdicts as JSON, or rewrite OUT/ask.csv after each verdict."""
    from workflows.ask import records
    from workflows.figures import files

    answers, path = [], f"{out}/ask.csv"
    for n, strengths in enumerate(forcings, 1):
        answers.append(records.answered(strengths, prove))
        if is_table and not quiet:
            click.echo(f"{n} of {len(forcings)}: {records.line(answers[-1])}", err=as_json)
        if not as_json:
            files.write(path, records.csv_of(answers))
    if as_json:
        click.echo(json.dumps(answers if is_table else answers[0], ensure_ascii=False))
    else:
        click.echo(f"tables:  {path}")


def _answer(strengths, point, kappa, plane, once, prove, column, out):
    """Print the answer for one forcing, and draw its figure."""
    from workflows.ask.once import answer_aperiodic
    from workflows.ask.period import answer_periodic
    from workflows.shared.verdict_sentences import MAX_LISTED

    text, draw = answer_aperiodic(strengths) if once else answer_periodic(strengths, point, prove)
    click.echo(text)

    from workflows.figures.style import drawn

    parts = ["ask", plane.name] if plane else ["ask"]
    parts += [Path(once).stem] if once else map(str, kappa[:MAX_LISTED])
    parts += [f"{crc32(strengths):08x}"] if len(kappa) > MAX_LISTED else []  # hash of all strengths
    paths, reason = drawn(draw, out, re.sub("[:/,]", "-", "_".join(parts)), text, column)
    if reason:
        raise click.ClickException(reason)
    click.echo(f"figures: {', '.join(paths)}")


@cli.command(ignore_unknown_options=True)
@click.argument("kappa", type=cli.StrengthOrFile(), nargs=-1)
@cli.point_option
@click.option("--once", type=cli.FILE, help="Text file with the kicks of an aperiodic forcing.")
@cli.flag("--prove", "Try to prove the answer, within 20 CPU seconds.")
@cli.flag("--json", "Print the answer, or a list of answers, as JSON; draw nothing.")
@cli.column_option
@cli.quiet_option
@cli.directory("Directory for the figure or the table.")
def main(kappa, plane, once, prove, json, column, quiet, out):
    from workflows.shared.forcing_files import read_forcings

    try:
        forcings, is_table = [], False
        if paths := [word for word in kappa if isinstance(word, Path)]:
            if plane or once:
                raise ValueError(f"{paths[0]} is the whole forcing; leave --plane and --once out")
            forcings, is_table = read_forcings(kappa)
            kappa = tuple(forcings[0].tolist())
        strengths, point = (None, None) if is_table else parse_forcing(kappa, plane, once)
        if once and (prove or json):
            option = "--prove" if prove else "--json"
            raise ValueError(f"{option} needs a periodic forcing; leave it or --once out")
        if not json:
            os.makedirs(out, exist_ok=True)
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    except OSError as error:
        raise click.UsageError(f"--out={out}: {error.strerror}; choose another directory") from None
    cli.announce_kernels(quiet)
    if is_table or json:
        return _answer_as_data(forcings or [strengths], is_table, prove, json, quiet, out)
    return _answer(strengths, point, kappa, plane, once, prove, column, out)
