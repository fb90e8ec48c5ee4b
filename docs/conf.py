"""How the pages are built: `make docs` writes build/docs, and a warning is an error."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

import skinmap

project = "Skinmap"
author = "The Skinmap developers"
version = release = skinmap.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "myst_parser",
    "mathml",  # ours, in docs/_ext: formulas as MathML, which needs no script
    "generated",  # lists of commands, modules, schemas and tables of contents
    "tutorials",  # scripts as pages
]
root_doc = "index"
exclude_patterns = ["_ext", "examples", "conf.py"]
# Several classes have a `channels`; sklearn documents its own methods with links of its own.
suppress_warnings = ["ref.python", "ref.term", "ref.ref"]

myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3
myst_links_external_new_tab = False

default_role = "code"  # docstrings put names in single backticks
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 88
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"Skinmap {version}"
html_static_path = ["_static"]
html_css_files = ["skinmap.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_copyright = False
pygments_style = "friendly"
