"""All commands: `python -m workflows` lists them, `python -m workflows NAME` runs one of them."""

import click

from workflows.shared.cli import COMMON, commands, main_of, version
from workflows.shared.streams import Prepared


class _Commands(Prepared, click.Group):
    """The commands by name; each is imported only when it is needed."""

    def list_commands(self, context):
        return commands()

    def get_command(self, context, name):
        if name not in commands():
            context.fail(f"there is no command {name}; choose one of {', '.join(commands())}")
        return main_of(name)

    def format_commands(self, context, formatter):
        with formatter.section("Commands, each with --help"):
            questions = [(name, main_of(name).help.partition("\n")[0]) for name in commands()]
            formatter.write_dl(questions, col_max=20)


@click.group(cls=_Commands, invoke_without_command=True, context_settings=COMMON)
@version
@click.pass_context
def main(context):
    """Where does the last barrier to transport break? Answers for the nonautonomous standard map.

    COMMAND is run as `python -m workflows COMMAND`, `python -m workflows.COMMAND`, or
    `nasm-transport COMMAND`.
    """
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


if __name__ == "__main__":
    main(prog_name="python -m workflows")
