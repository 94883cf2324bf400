# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The places of the package's data files (`config/`, `maps/`), installed or in a checkout."""

import json
import os
from pathlib import Path
from typing import Any

PACKAGE = "sparse_coord_ros"


def share_file(folder: str, name: str) -> Path | None:
    """Return the shipped file `folder/name`, or None if the package has no such file.

    A name must be plain: it cannot lead into another folder.
    """
    if Path(name).name != name:
        return None
    path = share_folder(folder) / name
    return path if os.path.isfile(path) else None


def shipped_json(name: str) -> dict[str, Any]:
    """Return the contents of the shipped file `config/name`; empty without one."""
    path = share_file("config", name)
    return {} if path is None else dict(json.loads(path.read_text(encoding="utf-8")))


def share_names(folder: str, suffix: str) -> list[str]:
    """Return the stems of the shipped files of a folder that end in `suffix`, sorted."""
    return sorted(path.stem for path in share_folder(folder).glob(f"*{suffix}"))


def share_folder(folder: str) -> Path:
    """Return the folder of shipped data files.

    A checkout has it beside the package; an installed package has it under
    `<prefix>/share/sparse_coord_ros`, where the prefix (a virtual environment, a colcon install
    space or /opt/ros/...) is some parent of this file. No ament index is needed.

    Raises:
        FileNotFoundError: the installation is broken: the folder is missing.
    """
    here = Path(__file__).resolve()
    candidates = [here.parents[2] / folder]
    candidates += [parent / "share" / PACKAGE / folder for parent in here.parents]
    for candidate in candidates:
        if candidate.is_dir():
            return candidate
    raise FileNotFoundError(
        f"{PACKAGE}: no folder {folder!r} beside the package or under share/{PACKAGE} of any "
        f"parent of {here}; reinstall the package"
    )
