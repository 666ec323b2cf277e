"""Sphinx settings for the site; build it with `python -m sphinx -W .docs out/site`.

The site is self-contained: its pages load no script, style or font from other sites.
"""

import re
import shutil
import sys
from pathlib import Path

from sphinx.errors import ExtensionError

import nasm

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import tables  # noqa: E402  (beside this file)

project = "NASM"
author = "The NASM developers"
copyright = f"2026, {author}"
version = release = nasm.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_click",
]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3

html_theme = "furo"
html_title = "NASM"
html_extra_path = ["live"]
html_copy_source = False
html_show_sourcelink = False
# Files in `generated` are included in other pages; those in `generated/api` are pages themselves.
exclude_patterns = ["live", "paper.md", "reference/generated/*.md", "**/.ipynb_checkpoints"]

# The build runs the pages with {code-cell} blocks. The two notebooks of workflows/examples are run
# by the tests; the site shows their stored outputs.
nb_execution_mode = "force"
nb_execution_excludepatterns = ["tutorials/generated/*"]
nb_execution_raise_on_error = True
nb_execution_timeout = -1  # no limit, because the time depends on the machine
nb_ipywidgets_js = {}  # no widgets, which would load scripts from other sites

autodoc_default_options = {"members": True}
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # docstrings state the types
napoleon_google_docstring = False
napoleon_use_rtype = False
# Letters in array shapes, such as "(n,)", are also the names of several attributes; it does not
# matter which of these Sphinx links to.
suppress_warnings = ["ref.python"]


def escape_marks(app, what, name, thing, options, lines):
    """Escape single | and * in docstrings, which are plain text, not markup."""
    for number, line in enumerate(lines):
        if not line.lstrip().startswith(">>>"):
            lines[number] = re.sub(r"(?<![\\*`])([|*])(?![*`])", r"\\\1", line)


def refuse_external_resources(app, error):
    """Fail if a page would load a script, a style, a font or a picture from outside the site."""
    if error or app.builder.name != "html":
        return
    loads = re.compile(
        r"<(?:script|img|iframe|source)\b[^>]*\bsrc=[\"']?(?:https?:)?//"
        r"|<link\b(?=[^>]*rel=[\"']?(?:stylesheet|preload|icon))[^>]*href=[\"']?(?:https?:)?//"
        r"|@import\s+[^;]*//|url\([\"']?(?:https?:)?//"
    )
    for path in [*Path(app.outdir).rglob("*.html"), *Path(app.outdir).rglob("*.css")]:
        if found := loads.search(path.read_text(encoding="utf-8")):
            raise ExtensionError(f"{path} loads an external resource: {found.group()}")


def copy_notebooks():
    """Copy the notebooks of workflows/examples into a folder from which Sphinx reads pages."""
    there = HERE / "tutorials" / "generated"
    there.mkdir(exist_ok=True)
    for path in (HERE.parent / "workflows" / "examples").glob("*.ipynb"):
        shutil.copy(path, there)


def copy_gallery(app, error):
    """Copy the output of `python -m workflows.gallery`, except its cubes, into the built site."""
    if not error and app.builder.name == "html" and tables.GALLERY.is_dir():
        there = Path(app.outdir) / "gallery"
        shutil.rmtree(there, ignore_errors=True)
        shutil.copytree(tables.GALLERY, there, ignore=shutil.ignore_patterns("*.zarr"))


def setup(app):
    copy_notebooks()
    tables.write(HERE / "reference" / "generated")
    app.connect("autodoc-process-docstring", escape_marks, priority=400)
    app.connect("build-finished", copy_gallery)
    app.connect("build-finished", refuse_external_resources)
