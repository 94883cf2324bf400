# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node that kills itself in a function: as `kill -9` would, at that very moment.

python test/dying.py MODULE:FUNCTION COUNT EXECUTABLE ARGUMENT...

The function's COUNT-th call never begins. `write_whole` has then written half of the file.
"""

import functools
import importlib
import os
import signal
import sys
from collections.abc import Callable
from typing import Any

from sparse_coord_ros.base.files import PARTIAL


def die() -> None:
    """End this process at once."""
    os.kill(os.getpid(), signal.SIGKILL)


def half_written(path: Any, data: bytes, **more: Any) -> None:
    """Write half of a file, and die."""
    path.with_name(path.name + PARTIAL).write_bytes(data[: len(data) // 2])
    die()


def dying(function: Callable[..., Any], count: int) -> Callable[..., Any]:
    """Return a function that lets the process die at a call of its own."""
    calls = 0

    @functools.wraps(function)
    def wrapped(*arguments: Any, **more: Any) -> Any:
        nonlocal calls
        calls += 1
        if calls < count:
            return function(*arguments, **more)
        return half_written(*arguments) if function.__name__ == "write_whole" else die()

    return wrapped


def main() -> int:
    """Run one of our executables, which dies."""
    where, count, executable = sys.argv[1:4]
    del sys.argv[1:4]
    module, names = where.split(":")
    owner: Any = importlib.import_module(module)
    *path, name = names.split(".")
    for one in path:
        owner = getattr(owner, one)
    setattr(owner, name, dying(getattr(owner, name), int(count)))
    from sparse_coord_ros import executables

    return executables.main(executable)


if __name__ == "__main__":
    sys.exit(main())
