"""Settings of Sphinx for the documentation: `make docs` makes build/site.

Pages are written for a reader of the repository, wherever they are in it: their links are relative
paths, and those that lead to a source file become downloads.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

ROOT = Path(__file__).parents[1]

project = "Real-time surrogates of large-deformation solids"
html_title = "Real-time surrogates"
root_doc = "docs/index"
include_patterns = [
    "docs/**",
    "docker/README.md",
    "shared_schema/README.md",
    "tools/README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "SECURITY.md",
]
exclude_patterns = ["**/.*", "build", "data", "runs", "**/smoke", "**/node_modules"]
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]

html_theme = "furo"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_extra_path = ["index.html"]
html_copy_source = False
html_show_copyright = False
pygments_style, pygments_dark_style = "friendly", "native"

myst_enable_extensions = ["attrs_inline", "dollarmath"]
myst_heading_anchors = 4
nb_execution_mode = "off"

# The reference of Python imports the packages, with those of the learner's environment behind.
sys.path += [str(ROOT), *map(str, ROOT.glob(".venv-surrogate/lib/python*/site-packages"))]
autodoc_mock_imports = ["basix", "cffi", "dolfinx", "gmsh", "mpi4py", "petsc4py", "ufl"]
autodoc_default_options = {"exclude-members": "model_config"}
autodoc_member_order = "bysource"
maximum_signature_line_length = 88
toc_object_entries_show_parents = "hide"
autodoc_typehints = "signature"
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
suppress_warnings = ["ref.python"]  # words of docstrings that two classes have as attributes

LINK = re.compile(r"\[([^\]]*)\]\(([^)#:\s]+)\)")
TITLED = re.compile(r'^```(\w+) title="(.+)"$', re.MULTILINE)


def setup(app: Sphinx) -> None:
    """Add what no extension does."""
    app.add_html_math_renderer("mathml", (_inline_formula, None), (_formula, None))
    app.config.html_math_renderer = "mathml"
    app.connect("source-read", _adapt)


def _inline_formula(translator: HTML5Translator, node: nodes.math) -> None:
    """Write a formula as MathML, which browsers show without a script."""
    translator.body.append(convert(node.astext()))
    raise nodes.SkipNode


def _formula(translator: HTML5Translator, node: nodes.math_block) -> None:
    formula = convert(node.astext(), display="block")
    translator.body.append(f'<div class="formula">{formula}</div>')
    raise nodes.SkipNode


def _adapt(app: Sphinx, document: str, content: list[str]) -> None:
    """Show the title of a code block, the name of its file; unlink folders, which are no pages."""
    folder = (ROOT / document).parent

    def unlinked(link: re.Match[str]) -> str:
        return link[1] if (folder / link[2]).is_dir() else link[0]

    text = TITLED.sub(r"```{code-block} \1\n:caption: \2\n", content[0])
    content[0] = LINK.sub(unlinked, text)
