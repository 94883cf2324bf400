# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tests use public names alone: what is private may change without them."""

import ast
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
PUBLIC = {
    "_asdict",
    "_fields",
    "_make",
    "_replace",
    "_repr_html_",
    "_repr_png_",
    "_exit",
}
"""Of named tuples, of what a notebook shows, and `os._exit`."""
OWN = {"self", "cls"}
SETTERS = {"setattr", "delattr", "getattr", "hasattr"}
"""Functions, and methods of `monkeypatch`, that are handed a name as a text."""


def is_private(name):
    return name.startswith("_") and not name.startswith("__") and name not in PUBLIC


def private_names(tree):
    """Yield the lines and private names of others that a module reads, imports or sets."""
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.Attribute):
            own = isinstance(node.value, ast.Name) and node.value.id in OWN
            names = [] if own else [node.attr]
        elif isinstance(node, ast.ImportFrom):
            whole = [f"{node.module}.{one.name}" for one in node.names]
            names = parts_of(whole)
        elif isinstance(node, ast.Import):
            names = parts_of(one.name for one in node.names)
        elif isinstance(node, ast.Call) and called(node.func) in SETTERS:
            own = isinstance(node.args[0], ast.Name) and node.args[0].id in OWN
            names = [] if own else texts_of(node.args)
        for name in filter(is_private, names):
            yield node.lineno, name


def parts_of(modules):
    """Return the parts of the names of this package's modules and of what is in them."""
    ours = [one for one in modules if one.startswith("sparse_coord_ros.")]
    return [part for one in ours for part in one.split(".")]


def texts_of(arguments):
    """Return the parts of the texts among a call's arguments."""
    texts = [one.value for one in arguments if isinstance(one, ast.Constant)]
    return [part for one in texts if isinstance(one, str) for part in one.split(".")]


def called(function):
    """Return the name of what is called."""
    if isinstance(function, ast.Attribute):
        return function.attr
    return getattr(function, "id", "")


@pytest.mark.parametrize(
    "code",
    ["a._b", "a()._b(c)", "import sparse_coord_ros._b", "a = 1 if b._b else 2"]
    + ["from sparse_coord_ros.a import _b", "from sparse_coord_ros._b import c"]
    + ["setattr(a, '_b', 1)", "m.setattr('a._b', 1)", "monkeypatch.delattr(a, '_b')"],
)
def test_each_kind_is_found(code):
    assert [name for _, name in private_names(ast.parse(code))] == ["_b"]


@pytest.mark.parametrize("code", ["self._b", "a.__name__", "a._replace(b=1)", "_b(1)"])
def test_what_is_ones_own_or_public_is_not(code):
    assert list(private_names(ast.parse(code))) == []


def test_no_test_reads_a_private_name():
    found = []
    for path in sorted(TESTS.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for line, name in private_names(tree):
            found.append(f"{path.relative_to(TESTS)}:{line}: {name}")
    assert found == []
