# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Is everything installed that this package needs, and does numba compile?"""

import platform
import shutil
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

from sparse_coord_ros.doctor.findings import FINE, HINT, WRONG, Finding
from sparse_coord_ros.share import PACKAGE, share_folder
from sparse_coord_ros.version import __version__

OLDEST_PYTHON = (3, 11)

FOR_DEVELOPERS = ("test", "lint", "docs", "coverage", "examples")
"""Extras that only a checkout needs."""

ROS, FAST = "ros", "fast"
"""Extras that are looked at by trying them."""


def installation() -> Iterator[Finding]:
    """Look at this package, Python, and what the package requires."""
    package = Path(__file__).parents[1]
    yield _package(package)
    try:
        share_folder("config")
    except FileNotFoundError as error:
        yield Finding(
            WRONG, "package", str(error), "install it again, in a checkout: pip install ."
        )
    command = shutil.which("sparse_coord")
    if command and Path(command).resolve().parent != Path(sys.executable).resolve().parent:
        here = Path(sys.executable).parent
        if not (here / "sparse_coord").exists() or Path(command).parent != here:
            yield Finding(
                HINT,
                "package",
                f"the command sparse_coord is {command}, this Python is {sys.executable}",
                "activate one environment, or call sparse_coord with its path",
            )
    version = platform.python_version()
    if sys.version_info < OLDEST_PYTHON:
        oldest = ".".join(map(str, OLDEST_PYTHON))
        yield Finding(WRONG, "python", f"{version} is too old", f"use Python {oldest} or newer")
    else:
        yield Finding(FINE, "python", f"{version} on {platform.system()} {platform.machine()}")
    yield from requirements(metadata.requires(PACKAGE) or [])


def _package(package: Path) -> Finding:
    try:
        installed = metadata.version(PACKAGE)
    except metadata.PackageNotFoundError:
        return Finding(
            HINT,
            "package",
            f"{__version__} in {package}, found by its path alone",
            "install it (pip install ., or colcon build), so that other programs find it",
        )
    if installed != __version__:
        return Finding(
            WRONG,
            "package",
            f"{__version__} in {package}, but {installed} is what pip installed",
            "install this version again: pip install -e . (or make clean, then make test)",
        )
    return Finding(FINE, "package", f"{PACKAGE} {__version__} in {package}")


def requirements(required: list[str]) -> Iterator[Finding]:
    """Look at what the package requires.

    Args:
        required: the requirements, as the package's metadata has them.
    """
    there: list[str] = []
    without: dict[str, list[str]] = {}
    for text in required:
        one = Requirement(text)
        extra = next((e for e in _extras(one) if e not in FOR_DEVELOPERS), None)
        if one.marker is not None and extra is None:
            continue
        problem = _problem(one)
        if extra is not None:
            if problem and extra not in (ROS, FAST):
                without.setdefault(extra, []).append(one.name)
        elif problem:
            yield Finding(WRONG, "packages", problem, f"pip install '{one.name}{one.specifier}'")
        else:
            there.append(f"{one.name} {metadata.version(one.name)}")
    if there:
        yield Finding(FINE, "packages", ", ".join(there))
    for extra, names in without.items():
        yield Finding(
            FINE,
            "packages",
            f"without the extra {extra} ({', '.join(names)}); needed only by what uses it",
            f"in a checkout: pip install '.[{extra}]'",
        )


def _extras(one: Requirement) -> list[str]:
    """Return the extras that a requirement is for."""
    if one.marker is None:
        return []
    known = metadata.metadata(PACKAGE).get_all("Provides-Extra") or []
    return [extra for extra in known if one.marker.evaluate({"extra": extra})]


def _problem(one: Requirement) -> str:
    try:
        version = metadata.version(one.name)
    except metadata.PackageNotFoundError:
        return f"{one.name} is missing"
    if not one.specifier.contains(version, prereleases=True):
        return f"{one.name} is {version}, needed: {one.specifier}"
    return ""


def compiler() -> Iterator[Finding]:
    """Look at numba: whether it is there, compiles, and where it keeps what it compiled."""
    from sparse_coord_ros import kept

    try:
        import numba

        if numba.njit(lambda number: number + 1)(1) != 2:
            raise ImportError("it computes 1 + 1 wrongly")
    except Exception as error:  # whatever an installation that does not fit raises
        text = " ".join(str(error).split())
        if isinstance(error, ModuleNotFoundError) and error.name == "numba":
            yield Finding(
                HINT,
                "numba",
                "is not installed: the same results, but batches and train a hundred times slower",
                "pip install numba, or sudo apt install python3-numba",
            )
        else:
            yield Finding(
                WRONG,
                "numba",
                f"does not work: {text}",
                "install a numba that fits this numpy: pip install --upgrade numba numpy",
            )
        return
    folder = kept.folder()
    if folder is None:
        yield Finding(
            HINT,
            "numba",
            f"{numba.__version__} compiles, but cannot keep it: some ten seconds a process",
            f"make ~/.cache writable, or name a folder: export {kept.FOLDER_VARIABLE}=FOLDER",
        )
    else:
        done = "holds what is compiled" if any(folder.iterdir()) else "is empty: compiles once"
        yield Finding(FINE, "numba", f"{numba.__version__} compiles; {folder} {done}")
