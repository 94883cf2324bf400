# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shared parts of the verbs that make pictures: sources, output files, missing data."""

import argparse
import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from sparse_coord_ros.base.errors import RunError, SettingError, packages_needed
from sparse_coord_ros.base.files import import_apart, write_whole
from sparse_coord_ros.cli import options as shared

KINDS = (".png", ".svg", ".pdf")
"""The ends of the names of pictures."""


def out_option(kinds: Sequence[str]) -> shared.Option:
    """Return --out, which is required."""
    where = f"output file; its name ends in {' or '.join(kinds)}"
    return shared.Option("--out FILE", Path, where, {"required": True})


def check_out(path: Path, kinds: Sequence[str] = ()) -> str:
    """Return the kind of a file to write, and check it before any computation.

    Args:
        path: the file.
        kinds: the allowed ends of its name; empty: any.

    Raises:
        SettingError: its name has another end.
        RunError: it cannot be written.
    """
    kind = path.suffix.lower()
    shown = f"--out {str(path)[-100:]}"
    if kinds and kind not in kinds:
        raise SettingError(f"{shown}: allowed: a name that ends in {', '.join(kinds)}")
    if not path.parent.is_dir():
        raise RunError(
            f"{shown}: there is no folder {path.parent}; make it, or choose another"
        )
    if path.is_dir() or not os.access(path if path.exists() else path.parent, os.W_OK):
        raise RunError(f"{shown}: cannot be written; choose another place")
    return kind.removeprefix(".")


def write(options: argparse.Namespace, data: bytes | str, **facts: object) -> None:
    """Write the file of --out whole, and print its path; JSON output also has `facts`."""
    write_whole(options.out, data)
    size = options.out.stat().st_size
    document = {"file": options.out, "bytes": size, **facts}
    shared.tell(options, document, f"{options.out} ({size / 1000:.0f} kB)")


@contextmanager
def drawing() -> Iterator[None]:
    """Suppress Matplotlib's warnings, and its settings file in the current folder.

    Raises:
        RunError: a package is missing.
    """
    with packages_needed(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", module="matplotlib|PIL")
        warnings.filterwarnings("ignore", message="Glyph .* missing")
        import_apart("matplotlib", "matplotlibrc")
        yield
