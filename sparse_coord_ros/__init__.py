# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Robots that learn when and how to coordinate (Melo & Veloso, AAMAS 2009) on ROS 2.

The Python API. It needs neither ROS nor a compiler, and is loaded when one of its names is first
used::

    import sparse_coord_ros as sc

    scenario = sc.load_scenario("env1")
    training = sc.train(scenario, "coop", seed=1)
    print(sc.evaluate(training).mean("returns"), sc.optimum(scenario).value)
"""

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

from sparse_coord_ros.base.version import __version__ as __version__

if TYPE_CHECKING:
    from sparse_coord_ros.api import *  # noqa: F403 - it says what its names are


def __getattr__(name: str) -> object:
    """Load the API when one of its names is first used (PEP 562)."""
    if name == "__all__" or not (
        name.startswith("_") or find_spec(f"{__name__}.{name}")
    ):
        api = import_module(f"{__name__}.api")
        if name in ("__all__", *api.__all__):
            return globals().setdefault(name, getattr(api, name))
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the names of the API, loaded or not."""
    return sorted({*globals(), *import_module(f"{__name__}.api").__all__})
