"""Forcings whose last breakup is known from independent methods, and their exact images.

The table of these judged forcings is `judged_forcings.csv`.
"""

import csv
from dataclasses import dataclass
from math import inf
from pathlib import Path

import numpy as np

TABLE = Path(__file__).with_name("judged_forcings.csv")


@dataclass(frozen=True)
class Row:
    """One judged ray κ = start + s·profile; comments in the table explain its columns."""

    number: int
    kind: str
    profile: tuple
    start: tuple | None
    value: float
    error: float
    lower: float
    upper: float
    omega: str
    method: str

    @property
    def exists_below(self):
        """The largest scale just below which a circle is known to exist."""
        residues = self.value - self.error if "bracket" not in self.method else -inf
        return max(self.lower, residues)

    @property
    def image_of(self):
        """The number of the original row and the operations that map it to this image, or None."""
        if not self.method.startswith("image of "):
            return None
        number, operations = self.method.removeprefix("image of ").split(": ")
        return int(number), operations

    def text(self):
        """Return the row as a line of the table."""
        numbers = (self.value, self.error, self.lower, self.upper)
        fields = [str(self.number), self.kind, spelled(self.profile), spelled(self.start or ())]
        fields += [f"{number:.17g}" for number in numbers]
        return ",".join([*fields, f'"{self.omega}"', f'"{self.method}"'])


def spelled(strengths):
    return " ".join(f"{strength!r}" for strength in map(float, strengths))


def table():
    """Return a dict of the Rows of the table, with their numbers as keys."""
    lines = [line for line in TABLE.read_text().splitlines() if not line.startswith("#")]
    rows = {}
    for cells in csv.DictReader(lines):
        profile, start = (tuple(map(float, cells[name].split())) for name in ("profile", "start"))
        numbers = [float(cells[name]) for name in ("value", "error", "lower", "upper")]
        row = Row(
            int(cells["row"]),
            cells["class"],
            profile,
            start or None,
            *numbers,
            cells["omega"],
            cells["method"],
        )
        rows[row.number] = row
    return rows


def image(row, operations):
    """Return the image of a row's ray (profile, start), and the factor and shift of its scales.

    A barrier of the row that breaks at s has an image that breaks at factor·s - shift.

    operations : one or more of these strings, in the order of application, separated by "; ":
        "shift n"    begin the period n kicks later,
        "reverse"    put the last kick first: time is reversed,
        "negate"     κ → -κ: x → x + 1/2,
        "alternate"  κ_n → (-1)ⁿ κ_n, for an even number of kicks: y → y + 1/2,
        "repeat n"   write the period n times,
        "pause n"    insert n - 1 zeros after each kick: y → y/n and κ → κ/n,
        "times c"    multiply the profile by c,
        "from t"     begin the ray at start = t·profile.
    """
    profile, start, factor, shift = np.array(row.profile), np.array(row.start or ()), 1.0, 0.0
    for operation in operations.split("; "):
        name, *arguments = operation.split()
        number = float(arguments[0]) if arguments else 0.0
        n = int(number)
        if name == "shift":
            profile, start = np.roll(profile, -n), np.roll(start, -n)
        elif name == "reverse":
            profile, start = profile[::-1], start[::-1]
        elif name == "negate":
            profile, start = -profile, -start
        elif name == "alternate" and profile.size % 2 == 0:
            profile, start = (at * (-1.0) ** np.arange(at.size) for at in (profile, start))
        elif name == "repeat":
            profile, start = np.tile(profile, n), np.tile(start, n)
        elif name == "pause" and not start.size:
            profile, factor = np.kron(profile, np.eye(n)[0]), factor / n
        elif name == "times" and number:
            profile, factor, shift = number * profile, factor / number, shift / number
        elif name == "from" and not start.size:
            start, shift = number * profile, shift + number
        else:
            raise ValueError(f"{operation!r} cannot be applied to profile={profile}, start={start}")
    return tuple(profile + 0.0), tuple(start + 0.0) or None, factor, shift


def image_row(number, kind, row, operations):
    """Return the Row that describes the image of a row under some operations."""
    profile, start, factor, shift = image(row, operations)
    value, lower, upper = (factor * scale - shift for scale in (row.value, row.lower, row.upper))
    error = abs(factor) * row.error + 4e-16 * abs(value)
    keeps = not any(word in operations for word in ("alternate", "repeat", "pause"))
    omega, method = row.omega if keeps else "", f"image of {row.number}: {operations}"
    return Row(number, kind, profile, start, value, error, lower, upper, omega, method)
