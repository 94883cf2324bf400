# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled loops kept on disk, so that numba compiles them once a machine, not once a process.

Numba looks only at the file of the loop itself to see whether what it kept is still good. So each
version of the sources has a folder of its own here, named by a digest of them all.
"""

import functools
import hashlib
import os
import shutil
from collections.abc import Callable, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

FOLDER_VARIABLE = "SPARSE_COORD_CACHE"
"""Environment variable: where to keep compiled loops; empty: nowhere. Unless it is set they are
in `sparse_coord_ros` of the user's cache directory (XDG_CACHE_HOME, or ~/.cache)."""

COMPILER = ("numba", "llvmlite", "numpy")
"""Installed packages whose versions the compiled code depends on."""

SOURCES = ("game", "learn", "solve", "engine")
"""Packages that the loops, what they call and their constants come from."""


@functools.cache
def folder() -> Path | None:
    """Return where this version's loops are kept; None where nothing can be kept."""
    named = os.environ.get(FOLDER_VARIABLE)
    if named == "":
        return None
    try:
        base = Path(named) if named else _user_cache()
        found = base / _version()
        found.mkdir(parents=True, exist_ok=True, mode=0o700)
        return found if os.access(found, os.W_OK | os.X_OK) else None
    except (OSError, RuntimeError, PackageNotFoundError):  # no room, no home, no numba
        return None


def _user_cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "sparse_coord_ros"


def _version() -> str:
    """Return a digest of whatever the compiled code depends on, beside the processor."""
    return digest_of_sources("\n".join(map(version, COMPILER)))


def digest_of_sources(compiler: str = "") -> str:
    """Return a digest of the sources of whatever computes, and of what compiles them."""
    digest = hashlib.sha256(compiler.encode())
    package = Path(__file__).parents[0]
    for name in SOURCES:
        for path in sorted((package / name).glob("*.py")):
            digest.update(f"\n{path.name}\n".encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def jit(loops: Sequence[Callable[..., Any]], **options: Any) -> list[Callable[..., Any]]:
    """Return loops that numba compiles when they are first called, or takes from disk."""
    import numba

    place, config = folder(), vars(numba.config)
    before = config["CACHE_DIR"]
    if place is not None:
        config["CACHE_DIR"] = str(place)
    try:
        return [numba.njit(nogil=True, cache=place is not None, **options)(loop) for loop in loops]
    finally:
        config["CACHE_DIR"] = before


def is_kept(key: str) -> bool:
    """Whether the loops of that name were compiled before: they need no compiling now."""
    place = folder()
    return place is not None and (place / key).exists()


def keep(key: str) -> None:
    """Note that the loops of that name are compiled."""
    place = folder()
    if place is not None:
        try:
            (place / key).touch()
        except OSError:  # a full disk: they are compiled again next time
            return


def forget() -> bool:
    """Throw away what is kept, as it cannot be read; return whether there was anything."""
    place = folder()
    there = place is not None and any(place.iterdir())
    for path in place.iterdir() if place is not None else ():
        shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
    return there
