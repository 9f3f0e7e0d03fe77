"""The documentation site: ``pip install ".[docs]" && python -m sphinx -W docs site``."""

import os
import re
import shutil
from importlib.metadata import version as version_of
from pathlib import Path

project = "haptune"
author = "The haptune founders"
release = version_of("haptune")
version = release
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 600
nb_merge_streams = True
napoleon_use_ivar = True
autodoc_member_order = "bysource"
autodoc_default_options = {"exclude-members": "model_config"}
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
html_theme = "furo"
html_title = f"haptune {release}"
html_show_copyright = False
html_static_path = ["_static"]
html_css_files = ["narrow.css"]
exclude_patterns = ["_build"]

_DOCS = Path(__file__).parent
_NOTEBOOKS = (*_DOCS.glob("../notebooks/*.ipynb"), _DOCS / "../tune/templates/study.ipynb")

_LITERAL = re.compile(r"(``.*?``)")
_ARRAY = re.compile(
    r"~?numpy\.ndarray\[tuple\[(?:~?typing\.)?Any, \.\.\.\], "
    r"~?numpy\.dtype\[~?numpy\.([a-z]+)\d*\]\]"
)
_UNIT = re.compile(r"^(\s+\w+: )(?=[A-Za-z]\.$)")


def _escape_formulas(app, what, name, obj, options, lines):
    """Bars and stars in docstrings are mathematics, not markup; "s." is no list's first item."""
    for index, line in enumerate(lines):
        parts = _LITERAL.split(line)
        parts[::2] = [re.sub(r"([|*])", r"\\\1", each) for each in parts[::2]]
        lines[index] = _UNIT.sub(r"\1\\", "".join(parts))


def _array_names(text):
    """Types of arrays by the names that the code has for them."""
    return _ARRAY.sub(lambda found: f"{found[1].capitalize()}Array", text)


def _name_arrays(app, what, name, obj, options, signature, returned):
    return tuple(each and _array_names(each) for each in (signature, returned))


def _name_arrays_of_attributes(app, what, name, obj, options, lines):
    lines[:] = map(_array_names, lines)


def _take_notebooks(app):
    """Copies of all notebooks, run as the site is built; some take the tests' own references."""
    folder = _DOCS / "notebooks"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for path in _NOTEBOOKS:
        shutil.copy(path, folder)
    os.environ["PYTHONPATH"] = str(_DOCS.parent)


def setup(app):
    """Sphinx calls it once."""
    app.connect("builder-inited", _take_notebooks)
    app.connect("autodoc-process-signature", _name_arrays)
    # After napoleon, which writes the types of attributes.
    app.connect("autodoc-process-docstring", _name_arrays_of_attributes, priority=600)
    app.connect("autodoc-process-docstring", _escape_formulas, priority=400)
