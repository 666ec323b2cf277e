"""Forcings in text files, with spaces, lines or commas between numbers."""

import re
from collections.abc import Sequence
from pathlib import Path

from nasm.maps import forcing
from nasm.texts import abbreviate, parse_float
from nasm.types import FloatArray


def read_forcings(words: Sequence[float | Path]) -> tuple[list[FloatArray], bool]:
    """Return the forcings that KAPPA ... are, strengths or one file, and whether it is a table.

    ValueError if a file is beside other words, or has anything but numbers.
    """
    paths = [word for word in words if isinstance(word, Path)]
    if not paths:
        return [forcing(words)], False  # type: ignore[arg-type]
    if len(words) > 1:
        raise ValueError(f"{paths[0]} is the whole forcing; leave other KAPPA out")
    try:
        return forcings_in(paths[0].read_bytes())
    except (ValueError, OSError) as error:
        raise ValueError(f"{paths[0]}: {error}") from None


def numbers_in(content: bytes) -> list[float]:
    """Return the numbers of a text file, with spaces, lines, or commas and spaces between them."""
    text = _decoded(content)
    for word in text.split():
        if re.search(r"\d,\d", word):
            cure = "may be one number or two; write one like 0.3, and two like 0 3"
            raise ValueError(f"{abbreviate(word)} {cure}")
    return [parse_float(word) for word in text.replace(",", " ").split()]


def forcings_in(content: bytes) -> tuple[list[FloatArray], bool]:
    """Return the forcings of a text file, and whether it is a table with one in each line.

    A file with one number a line, or with one line, is one forcing. In a table numbers have commas
    or spaces between them, lines may differ in length, and names of columns in the first line are
    skipped. ValueError, with the number of the line, for anything else.
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
    """Return the text of a file, with the mark of Windows' editors, or without."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError("not a text in UTF-8, e.g. one in UTF-16; save it as UTF-8") from None


def _words(line: str) -> list[str]:
    """Return the words of a line before a #, with spaces, commas or semicolons between them."""
    numbers = line.partition("#")[0].strip(" \t,;")
    return re.split(r"[\s,;]+", numbers) if numbers else []


def _is_number(word: str) -> bool:
    try:
        parse_float(word)
    except ValueError:
        return False
    return True
