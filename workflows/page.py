"""A page of HTML that needs nothing but itself: headings, paragraphs, tables; no scripts.

All text is escaped, but for `Markup`, which the functions here make.
"""

import re
from html import escape

_STYLE = """
body { font: 17px/1.5 Georgia, serif; color: #1a1a1a; max-width: 82rem; margin: 2rem auto;
       padding: 0 1.5rem; }
h1, h2 { line-height: 1.2; font-weight: normal; }
h2 { margin-top: 2.5em; }
p { max-width: 46em; }
table { border-collapse: collapse; font-size: 0.85rem; width: 100%; }
caption { caption-side: top; text-align: left; padding-bottom: 0.5em; }
th, td { text-align: left; vertical-align: top; padding: 0.45em 0.8em; }
td { border-top: 1px solid #ddd; overflow-wrap: break-word; }
th { border-bottom: 2px solid #1a1a1a; position: sticky; top: 0; background: white; }
code { font-size: 0.8rem; overflow-wrap: anywhere; }
sub { font-size: 0.75em; line-height: 0; }
tr.yes td:first-child { border-left: 5px solid #009e73; }
tr.partly td:first-child { border-left: 5px solid #e69f00; }
tr.no td:first-child { border-left: 5px solid #d55e00; }
tr.unknown td:first-child { border-left: 5px solid #999; }
"""


class Markup(str):
    """Text that is HTML already."""


def page(title, *sections):
    """The whole document, a str."""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{escape(title)}</h1>\n" + "\n".join(map(_html, sections)) + "\n</body>\n</html>\n"
    )


def heading(text):
    return Markup(f"<h2>{_html(text)}</h2>")


def paragraph(*parts):
    return Markup(f"<p>{''.join(map(_html, parts))}</p>")


def code(text):
    return Markup(f"<code>{escape(text)}</code>")


def formula(text):
    """Plain text in which T_κ1κ2, x_n and R_{-½} have their subscripts; labels (sim_M) stay."""
    return Markup(_SUBSCRIPT.sub(_lowered, escape(text)))


_SUBSCRIPT = re.compile(r"\(\w{2,}_\w+\)|_\{([^}]*)\}|_([κωγε½A-Za-z0-9]+)")


def _lowered(match):
    below = match[1] or match[2]
    return f"<sub>{below}</sub>" if below else match[0]


def table(rows, header, classes=None):
    """A table; `classes` colour the rows: "yes", "partly", "no", "unknown" or ""."""
    head = "".join(f"<th>{_html(cell)}</th>" for cell in header)
    body = []
    for row, name in zip(rows, classes or [""] * len(rows), strict=True):
        cells = "".join(f"<td>{_html(cell)}</td>" for cell in row)
        body.append(f'<tr class="{escape(name)}">{cells}</tr>' if name else f"<tr>{cells}</tr>")
    body = "\n".join(body)
    return Markup(f"<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table>")


def _html(text):
    return text if isinstance(text, Markup) else escape(str(text))
