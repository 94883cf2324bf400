# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Is this package installed as a whole, and does numba compile?"""

import platform
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from sparse_coord_ros import compiling
from sparse_coord_ros.doctor.findings import FINE, HINT, WRONG, Finding
from sparse_coord_ros.share import PACKAGE, share_folder
from sparse_coord_ros.version import __version__


def installation() -> Iterator[Finding]:
    """Look at this package; `pip check` says whether what it requires fits."""
    package = Path(__file__).parents[1]
    here = f"{__version__} in {package}, Python {platform.python_version()}"
    try:
        share_folder("config")
        installed = metadata.version(PACKAGE)
    except FileNotFoundError as error:
        remedy = "install it again, in a checkout: pip install ."
        yield Finding(WRONG, "package", str(error), remedy)
        return
    except metadata.PackageNotFoundError:
        yield Finding(
            HINT,
            "package",
            f"{here}, found by its path alone",
            "install it (pip install ., or colcon build), so that other programs find it",
        )
        return
    if installed != __version__:
        yield Finding(
            WRONG,
            "package",
            f"{here}, but {installed} is what pip installed",
            "install this version again: pip install -e . (or make clean, then make test)",
        )
    else:
        yield Finding(FINE, "package", here)


def compiler() -> Iterator[Finding]:
    """Look at numba: whether it is there, compiles, and where it keeps what it compiled."""
    try:
        import numba

        if numba.njit(lambda number: number + 1)(1) != 2:
            raise ImportError("it computes 1 + 1 wrongly")
    except ModuleNotFoundError:
        yield Finding(
            HINT,
            "numba",
            "is not installed: the same results, but batches and train a hundred times slower",
            "pip install numba, or sudo apt install python3-numba",
        )
        return
    except Exception as error:  # whatever an installation that does not fit raises
        yield Finding(
            WRONG,
            "numba",
            f"does not work: {' '.join(str(error).split())}",
            "install a numba that fits this numpy: pip install --upgrade numba numpy",
        )
        return
    folder = compiling.folder()
    if folder is None:
        yield Finding(
            HINT,
            "numba",
            f"{numba.__version__} compiles, but cannot keep it: some ten seconds a process",
            f"make ~/.cache writable, or name a folder: export {compiling.FOLDER_VARIABLE}=FOLDER",
        )
    else:
        yield Finding(FINE, "numba", f"{numba.__version__} compiles, and keeps it in {folder}")
