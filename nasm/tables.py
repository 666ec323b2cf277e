"""Results as text and as tables for notebooks."""

from collections.abc import Mapping
from enum import Enum
from html import escape

from nasm.numbers import RotationNumber

__all__ = ["html_table", "omega_text", "status_text"]


def omega_text(number: RotationNumber, period: int) -> str:
    """Return a rotation number as text: continued fraction and decimals, per period and per kick.

    Examples
    --------
    >>> from nasm.numbers import parse
    >>> from nasm.tables import omega_text
    >>> omega_text(parse("2gamma"), 2)
    '[1;(4)] = 1.2360679775 per period of 2 kicks, 0.61803398875 per kick'
    """
    per_kick = f"{float(number) / period:.12g} per kick"
    if period == 1:
        return f"{number} = {per_kick}"
    return f"{number} = {float(number):.12g} per period of {period} kicks, {per_kick}"


def status_text(status: Enum) -> str:
    """Return the name of a status, with the reason and the remedy unless the status is OK.

    Examples
    --------
    >>> from nasm.results import Status
    >>> from nasm.tables import status_text
    >>> status_text(Status.OK)
    'OK'
    """
    return status.name if status.name == "OK" else f"{status.name}: {status.value}"


def html_table(rows: Mapping[str, str], caption: str = "") -> str:
    """Return a table of two columns as HTML, leaving out rows without text.

    Examples
    --------
    >>> from nasm.tables import html_table
    >>> html_table({"error": "1e-12", "method": ""}, "A circle")
    '<table><caption>A circle</caption><tr><th>error</th><td>1e-12</td></tr></table>'
    """
    head = f"<caption>{escape(caption)}</caption>" if caption else ""
    lines = (
        f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>"
        for name, text in rows.items()
        if text
    )
    return f"<table>{head}{''.join(lines)}</table>"
