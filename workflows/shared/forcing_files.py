"""Forcings in text files, with numbers separated by spaces, line breaks or commas."""

import re
from collections.abc import Sequence
from pathlib import Path

from nasm.maps import forcing
from nasm.texts import abbreviate, parse_float
from nasm.types import FloatArray


def read_forcings(words: Sequence[float | Path]) -> tuple[list[FloatArray], bool]:
    """Return the forcings that the KAPPA arguments specify, and True if they form a table.

    The arguments are the strengths of one forcing, or the path of one file. Raise ValueError if a
    file is combined with other arguments, or if it contains anything but numbers, comments and
    column names.
    """
    paths = [word for word in words if isinstance(word, Path)]
    if not paths:
        return [forcing(words)], False  # type: ignore[arg-type]
    if len(words) > 1:
        raise ValueError(f"{paths[0]} is the whole forcing; leave other KAPPA arguments out")
    try:
        return forcings_in(paths[0].read_bytes())
    except (ValueError, OSError) as error:
        raise ValueError(f"{paths[0]}: {error}") from None


def numbers_in(content: bytes) -> list[float]:
    """Return the numbers in a text file, separated by spaces, line breaks or commas with spaces."""
    text = _decoded(content)
    for word in text.split():
        if re.search(r"\d,\d", word):
            hint = "may be one number or two; write one like 0.3, or two with a space, like 0 3"
            raise ValueError(f"{abbreviate(word)} {hint}")
    return [parse_float(word) for word in text.replace(",", " ").split()]


def forcings_in(content: bytes) -> tuple[list[FloatArray], bool]:
    """Return the forcings in a text file, and True if it is a table with one forcing per line.

    A file with one number per line, or with a single line, contains one forcing. In a table, commas
    or spaces separate the numbers, lines may differ in length, and column names in the first line
    are skipped. For anything else, raise ValueError with the line number.
    """
    lines = [(n, _words(line)) for n, line in enumerate(_decoded(content).splitlines(), 1)]
    lines = [(n, words) for n, words in lines if words]
    if lines and not any(map(_is_number, lines[0][1])):
        lines = lines[1:]
    is_table = len(lines) > 1 and any(len(words) > 1 for _, words in lines)
    if not is_table:
        lines = [(lines[0][0] if lines else 1, [word for _, words in lines for word in words])]
    forcings = []
    for n, words in lines:
        try:
            forcings.append(forcing([parse_float(word) for word in words]))
        except ValueError as error:
            raise ValueError(f"line {n}: {error}") from None
    return forcings, is_table


def _decoded(content: bytes) -> str:
    """Return the text of a UTF-8 file, with or without a byte-order mark."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError("not UTF-8 text, perhaps UTF-16; save it as UTF-8") from None


def _words(line: str) -> list[str]:
    """Return the words of a line up to any #; spaces, commas or semicolons separate them."""
    numbers = line.partition("#")[0].strip(" \t,;")
    return re.split(r"[\s,;]+", numbers) if numbers else []


def _is_number(word: str) -> bool:
    try:
        parse_float(word)
    except ValueError:
        return False
    return True
