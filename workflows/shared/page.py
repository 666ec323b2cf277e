"""Pages of HTML that need nothing but themselves: jinja2 templates in which all text is escaped."""

import re
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from workflows.figures import files

_SUBSCRIPT = re.compile(r"\(\w{2,}_\w+\)|_\{([^}]*)\}|_([κωγε½A-Za-z0-9]+)")


def render(template, path, **values):
    """Write the page of a template, named by its path in `workflows`."""
    files.write(path, _ENVIRONMENT.get_template(template).render(values))


def formula(text):
    """Set the subscripts of T_κ1κ2, x_n and R_{-½} in plain text; labels (sim_M) stay."""

    def lowered(match):
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
