"""Self-contained HTML pages, rendered from jinja2 templates in which all text is escaped."""

import re
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from workflows.figures import files

_SUBSCRIPT = re.compile(r"\(\w{2,}_\w+\)|_\{([^}]*)\}|_([κωγε½A-Za-z0-9]+)")


def render(template: str, path: str | Path, **values: Any) -> None:
    """Render a template, named by its path in `workflows`, and write the page to `path`."""
    files.write(path, _ENVIRONMENT.get_template(template).render(values))


def formula(text: str) -> Markup:
    """Typeset subscripts in plain text, as in T_κ1κ2, x_n and R_{-½}, except in labels (sim_M)."""

    def lowered(match: re.Match[str]) -> str:
        below = match[1] or match[2]
        return f"<sub>{below}</sub>" if below else match[0]

    return Markup(_SUBSCRIPT.sub(lowered, escape(text)))


_ENVIRONMENT = Environment(
    loader=FileSystemLoader(Path(__file__).parents[1]),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    undefined=StrictUndefined,
)
_ENVIRONMENT.filters["formula"] = formula
