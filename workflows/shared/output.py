"""What a command writes into OUT: tables, figures with captions, and its findings in words."""

import click
import matplotlib

from workflows.figures.style import save
from workflows.shared.tables import write

matplotlib.use("agg")  # no window is opened


class Output:
    """Tables and figures of a command, and what it prints at the end.

    out : directory; it must exist when something is written.
    """

    def __init__(self, out):
        self.out, self.words, self.written = out, [], {}

    def table(self, name, dataset):
        """Write a Dataset as OUT/NAME.csv."""
        write(dataset, self.path("tables", f"{name}.csv"))

    def figure(self, name, figure, caption=""):
        """Write OUT/NAME.png and .pdf, and the caption beside them; the caption is printed too."""
        for path in save(figure, self.out, name, caption):
            self.note("figures", path)
        self.say(caption)

    def path(self, kind, name):
        """Return the path OUT/NAME of a file, named at the end among those of its kind."""
        return self.note(kind, f"{self.out}/{name}")

    def say(self, words):
        """Print a finding at the end, before the paths."""
        self.words.append(words)

    def note(self, kind, path):
        """Have the path named at the end, among those of its kind; return it."""
        self.written.setdefault(kind, {})[path] = None  # once, in order
        return path

    def finish(self):
        """Print what was found, and where it is."""
        for line in "\n".join(self.words).splitlines():
            click.echo(click.wrap_text(line, 100))
        for kind, paths in self.written.items():
            click.echo(f"{kind + ':':9}{', '.join(paths)}")
