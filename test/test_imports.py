# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parts that need no ROS import, and work, where ROS is not installed."""

from contextlib import closing
from pathlib import Path

import pytest
from recordings import write_run

import sparse_coord_ros
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.log.bags import BagWriter

PACKAGE = Path(sparse_coord_ros.__file__).parent

WITHOUT_ROS = """
import importlib, pkgutil, sys
ROS = ("rclpy", "rcl_interfaces", "std_msgs", "std_srvs", "geometry_msgs", "nav_msgs",
       "sensor_msgs", "visualization_msgs", "diagnostic_msgs", "rosgraph_msgs",
       "builtin_interfaces", "ament_index_python", "launch", "launch_ros")
for name in ROS:
    sys.modules[name] = None  # importing it raises ImportError

def load(package):
    module = importlib.import_module(f"sparse_coord_ros.{package}")
    names = [m.name for m in pkgutil.walk_packages(module.__path__, module.__name__ + ".")]
    for name in names:
        importlib.import_module(name)
    return names
"""


@pytest.fixture
def bare(python):
    """Return a function that runs code in an interpreter without ROS: what it printed."""
    return lambda code: python("-c", WITHOUT_ROS + code).stdout


WITHOUT_ROS_PARTS = ("base", "core", "protocol", "studies", "log", "lab", "show")
"""Parts that need no ROS: all below `ros` (see the layers in pyproject.toml)."""


def test_imports_without_ros(bare):
    out = bare(
        f"for package in {WITHOUT_ROS_PARTS}: print(package, len(load(package)))"
    )
    for package, modules in map(str.split, out.splitlines()):
        assert int(modules) > 1, package


def test_learning_needs_numpy_and_yaml_only(bare):
    out = bare(
        "before = {n.split('.')[0] for n in sys.modules}  # site hooks\n"
        "load('core.runs')\n"
        "known = sys.stdlib_module_names | {'sparse_coord_ros'}\n"
        "used = {n.split('.')[0] for n, m in sys.modules.items() if getattr(m, '__file__', '')}\n"
        "print(*sorted(n for n in used - known - before if n[0] != '_'))"
    )
    assert out.split() == ["numpy", "yaml"]


def test_help_and_small_verbs_start_fast(bare):
    out = bare(
        "from sparse_coord_ros.cli.main import main\n"
        "heavy = {'argcomplete', 'numba', 'matplotlib', 'sparse_coord_ros.core.engine'}\n"
        "for line in ('--help', 'maps', 'optimum env1', 'reproduce --help'):\n"
        "    try:\n"
        "        main(line.split())\n"
        "    except SystemExit:\n"
        "        pass\n"
        "    print('HEAVY', heavy & sys.modules.keys())\n"
        "    heavy -= {'sparse_coord_ros.core.engine'} if line == 'optimum env1' else set()"
    )
    assert [line for line in out.splitlines() if line.startswith("HEAVY")] == [
        "HEAVY set()"
    ] * 4


def test_command_line_without_ros(bare, tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "other/text").write_text("no bag")
    with closing(BagWriter(tmp_path / "bag")) as bag:
        write_run(bag, make_run(load_scenario("env1"), {}))
    out = bare(
        "from sparse_coord_ros.cli.main import main\n"
        "assert main(['maps', 'env1']) == 0\n"
        "assert main(['optimum', 'env1']) == 0\n"
        "assert main(['run', 'env1', '--out', '/nonexistent/out']) == 2\n"
        f"for verb, code in dict(info=0, verify=3, explain=0).items():\n"
        f"    assert main([verb, {str(tmp_path / 'bag')!r}]) == code, verb\n"
        f"    assert main([verb, {str(tmp_path / 'other/text')!r}]) == 2, verb\n"
        "assert not [n for n in sys.modules if n.startswith('sparse_coord_ros.ros.nodes')]\n"
        "from sparse_coord_ros.ros.doctor import round_trip\n"
        "round_trip.round_trip = lambda changes=None: {'missing': 'no rclpy'}\n"
        "assert main(['doctor']) == 0"
    )
    for words in (
        "21 cells",
        "120.56",
        "env1, coop, seed 0",
        "undecided from ",
        "no question",
        "is not there (no rclpy)",
    ):
        assert words in out
