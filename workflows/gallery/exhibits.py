"""Exhibits: commands, their titles, and their options for a preview and for a full-size run."""

import shlex
import tomllib
from dataclasses import dataclass
from pathlib import Path

import click

from workflows.shared.cli import main_of


@dataclass(frozen=True)
class Exhibit:
    """A command, its title, and its options for a preview and for the sizes used in the paper.

    `name` is the folder of its results. `beyond` is True if the exhibit addresses a question that
    is not in the paper. `command` is the name of the command, if it differs from `name`.
    """

    name: str
    title: str
    quick: str = ""
    full: str = ""
    beyond: bool = False
    command: str = ""

    @property
    def program(self):
        """Name of the command."""
        return self.command or self.name

    def options(self, quick):
        """Return the command-line options as a list."""
        return shlex.split(self.quick if quick else self.full)


def listed(file):
    """Return the Exhibits listed in a TOML file in this folder."""
    texts = tomllib.loads(Path(__file__).with_name(file).read_text(encoding="utf-8"))
    beyond = texts.pop("beyond", {})
    own = [Exhibit(name, **about) for name, about in texts.items()]
    return own + [Exhibit(name, **about, beyond=True) for name, about in beyond.items()]


def run(exhibit, out, workers, quick, quiet):
    """Run the command of an exhibit, which writes to the folder OUT/NAME."""
    main = main_of(exhibit.program)
    swept = any(option.name == "scheduler" for option in main.params)
    options = [*exhibit.options(quick), "--out", f"{out}/{exhibit.name}"]
    options += ["--quiet"] * quiet + [*workers] * swept
    if not quiet:
        click.echo(f": {exhibit.title}", err=True)
    main.main(options, standalone_mode=False)


def command_of(exhibit, quick):
    """Return the command line for an exhibit, which writes to the folder `name`."""
    start = ["python", "-m", f"workflows.{exhibit.program}"]
    return shlex.join([*start, *exhibit.options(quick), "--out", exhibit.name])
