"""Documentation of control_kpos: sphinx-build -W -b html docs docs/_build/html."""

import os
import re
import shutil
from pathlib import Path

import control_kpos

HERE = Path(__file__).parent

project = "control_kpos"
author = "The control_kpos developers"
project_copyright = author
version = release = control_kpos.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.mathjax", "numpydoc"]
exclude_patterns = ["_build"]
templates_path = ["_templates"]
html_theme = "furo"
html_title = "control_kpos"
default_role = "code"
smartquotes = False  # v'x is a product

# -- notebooks: shown from copies, executed unless somebody has done so already

executed = os.environ.get("KPOS_EXECUTED_NOTEBOOKS")
shutil.rmtree(HERE / "notebooks", ignore_errors=True)
(HERE / "notebooks").mkdir()
for notebook in sorted(Path(executed or HERE.parent / "notebooks").glob("*.ipynb")):
    shutil.copy(notebook, HERE / "notebooks")
nb_execution_mode = "auto"
nb_execution_excludepatterns = ["notebooks/*"] if executed else []
nb_execution_raise_on_error = True
nb_execution_timeout = 600
nb_merge_streams = True
myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]
myst_heading_anchors = 3

# -- docstrings

autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say it
numpydoc_show_class_members = False
numpydoc_xref_param_type = False


def escape_mathematics(app, what, name, obj, options, lines):
    """Docstrings write |x|, X* and A_j for people; reStructuredText would read markup."""
    literal = False
    for i, line in enumerate(lines):
        if line.lstrip().startswith(">>>"):
            literal = True
        elif not line.strip():
            literal = False
        if not literal:
            pieces = re.split(r"(``[^`]*``|`[^`]*`)", line)
            pieces[::2] = [re.sub(r"(?<!^)(?<!^\*)[*|](?!\*\w)|_(?=\W|$)", r"\\\g<0>", piece) for piece in pieces[::2]]
            lines[i] = "".join(pieces)


def setup(app):
    """Run before numpydoc does."""
    app.connect("autodoc-process-docstring", escape_mathematics, priority=100)
