"""Sphinx: Markdown with dollar math; `make docs` treats every warning as an error."""

from middeck import __version__

project = "middeck"
author = "the middeck authors"
release = version = __version__
# Formulas are set by MathJax in the reader's browser; without a network they are read as TeX.
extensions = ["myst_parser", "sphinx.ext.mathjax"]
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = "middeck"
html_show_sphinx = False
