# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sphinx: the pages of this folder, and the reference of the Python API from its docstrings."""

import sparse_coord_ros
from sparse_coord_ros.cli.main import make_parser
from sparse_coord_ros.cli.verbs import VERBS, add_verb

project = "sparse_coord_ros"
author = "The sparse_coord_ros authors"
copyright = f"2026 {author}"  # noqa: A001 - Sphinx's name
release = sparse_coord_ros.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinxarg.ext",
]
exclude_patterns = ["_build", "tables"]
html_theme = "furo"
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


def every_verb():
    """Return the parser of all verbs with all their options, for the page of verbs."""
    parser = make_parser()
    verbs = parser._subparsers._group_actions[0]
    verbs.choices.clear()
    verbs._choices_actions.clear()
    for verb in VERBS:
        add_verb(verbs, verb)
    return parser
