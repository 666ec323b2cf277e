"""An exhibit: a command, what it shows, and its options for a preview and for the real size."""

import shlex
import tomllib
from dataclasses import dataclass
from pathlib import Path

import click

from workflows.shared.cli import main_of


@dataclass(frozen=True)
class Exhibit:
    """A command, what it shows, and its options for a preview and for the paper's size.

    beyond : whether the paper does not ask what it answers.
    """

    name: str
    title: str
    quick: str = ""
    full: str = ""
    beyond: bool = False

    def options(self, quick):
        return shlex.split(self.quick if quick else self.full)


def listed(file):
    """Return the Exhibits of a TOML file of this folder."""
    texts = tomllib.loads(Path(__file__).with_name(file).read_text(encoding="utf-8"))
    beyond = texts.pop("beyond", {})
    own = [Exhibit(name, **about) for name, about in texts.items()]
    return own + [Exhibit(name, **about, beyond=True) for name, about in beyond.items()]


def run(exhibit, out, workers, quick):
    """Run the command with its cubes, tables and figures in a directory of OUT."""
    main = main_of(exhibit.name)
    swept = any(option.name == "scheduler" for option in main.params)
    options = [*exhibit.options(quick), "--out", f"{out}/{exhibit.name}"]
    click.echo(f": {exhibit.title}", err=True)
    main.main([*options, *(workers if swept else [])], standalone_mode=False)


def command_of(exhibit, quick):
    """Return the command line of an exhibit, which writes into the folder of its name."""
    start = ["python", "-m", f"workflows.{exhibit.name}"]
    return shlex.join([*start, *exhibit.options(quick), "--out", exhibit.name])
