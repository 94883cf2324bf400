# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sphinx: the pages of this folder, the notebooks, which it runs, and the pages that it makes."""

import subprocess
import sys
from pathlib import Path

import sparse_coord_ros

project = "sparse_coord_ros"
author = "The sparse_coord_ros authors"
copyright = f"2026 {author}"  # noqa: A001 - Sphinx's name
release = sparse_coord_ros.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinxarg.ext",
    "mathml",
]
exclude_patterns = ["_build", "tables"]
myst_enable_extensions = ["amsmath", "dollarmath", "substitution"]
nb_execution_raise_on_error = True
nb_execution_timeout = 600
html_theme = "furo"
html_static_path = ["static"]
html_css_files = ["notebooks.css"]
html_title = f"sparse_coord_ros {release}"
myst_heading_anchors = 3
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_default_options = {"members": True, "show-inheritance": True}
autodoc_mock_imports = ["rclpy"]
napoleon_use_ivar = True
default_role = "code"  # docstrings have `names` in single backquotes
# Links to files of the repository; names that the API and a module of it both have.
suppress_warnings = ["myst.xref_missing", "ref.python"]

HERE = Path(__file__).parent
html_math_renderer = "mathml"
html_search_scorer = str(HERE / "static/scorer.js")
sys.path.append(str(HERE))
import generate  # noqa: E402 - it lies here

generate.everything()

asked = ["git", "-C", str(HERE), "remote", "get-url", "origin"]
place = subprocess.run(asked, capture_output=True, text=True).stdout.strip()
published = place.startswith(("https://", "ssh://", "git@"))
myst_substitutions = {
    "repository": place
    if published
    else "the checkout that these pages were built from"
}
