"""All commands, a line each."""

from importlib import import_module

import click

from workflows.parts.cli import command, commands


@command()
def main():
    """List the commands. Each is run as python -m workflows.NAME; --help gives its options."""
    lines = click.HelpFormatter(width=130)
    lines.write_dl([(name, _question(name)) for name in commands()], col_max=20)
    click.echo("python -m workflows.NAME --help, where NAME is one of\n")
    click.echo(lines.getvalue())


def _question(name):
    """Return the first line of what the command's module says of itself."""
    module = import_module(f"workflows.{name}")
    module = module if module.__doc__ else import_module(f"{module.__name__}.__main__")
    return module.__doc__.partition("\n")[0]


if __name__ == "__main__":
    main()
