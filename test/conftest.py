# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What all tests share: a ROS domain of their own, and nothing left behind.

To write a test, read this file. Then, where the test needs more:

- a scenario from the rows of a map, tables with chosen values: `drawn` and `tables_from_values` in
  teams.py (the fixture `make` is `drawn`);
- a recorded run: the fixture `record` here;
- a verb in this process: cli/conftest.py; a process of its own: the fixture `python` here;
- nodes: `Bench` in nodes/conftest.py, with an example in nodes/test_clocks.py.
"""

import gc
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from itertools import groupby

import pytest
from domains import ros_domain
from hypothesis import settings
from patience import PATIENCE_SECONDS
from teams import drawn

from sparse_coord_ros.base.compiling import FOLDER_VARIABLE
from sparse_coord_ros.core.game.perception import MODELS
from sparse_coord_ros.core.game.plugins import ALLOW_VARIABLE
from sparse_coord_ros.core.learners.registry import LEARNERS
from sparse_coord_ros.ros.nodes.environment import use_udp

settings.register_profile("tests", derandomize=True, max_examples=40, deadline=None)
settings.load_profile("tests")


@pytest.fixture
def own_domain(monkeypatch):
    """Give a test a ROS domain: what the one before said must not be heard in this one."""
    with ros_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        yield domain


@pytest.fixture(autouse=True)
def nothing_allowed(monkeypatch):
    """Let no test begin with modules that another one allowed to be imported, or registered."""
    monkeypatch.setenv(ALLOW_VARIABLE, "")
    for registry in (LEARNERS, MODELS):
        monkeypatch.setattr(registry, "registered", {**registry.registered})


@pytest.fixture(autouse=True, scope="session")
def ros_environment():
    """Keep ROS on this machine, in a domain of the run's own, with logs that vanish."""
    with (
        tempfile.TemporaryDirectory(prefix="sparse_coord_test_") as folder,
        ros_domain() as domain,
    ):
        settings = {
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_DOMAIN_ID": str(domain),
            "ROS_LOG_DIR": folder,
        }
        use_udp(settings)
        before = {name: os.environ.get(name) for name in settings}
        os.environ.update(settings)
        yield
        for name, value in before.items():
            if value is None:
                os.environ.pop(name)
            else:
                os.environ[name] = value


@pytest.fixture(scope="session")
def record(tmp_path_factory):
    """Return a function that records a run as `recordings.recorded`; equal ones only once."""
    known = {}

    def record(*given, **options):
        from recordings import recorded  # needs ROS

        key = repr((given, sorted(options.items())))
        if key not in known:
            known[key] = recorded(
                tmp_path_factory.mktemp("recorded"), *given, **options
            )
        return known[key]

    return record


@pytest.fixture(scope="session")
def good(record):
    """Return a recorded run of env1 in which half of the percepts fail; not to be changed."""
    return record(settings={"perception": "probability:0.5", "steps": 250})


@pytest.fixture(scope="session")
def rewritten():
    """Return a function that writes a bag anew, changed, with all checksums right."""
    from recordings import rewritten  # needs ROS

    return rewritten


def pytest_configure(config):
    """Keep compiled loops from one test run to the next, in pytest's cache, by their sources.

    Where the caller names a folder for them (`SPARSE_COORD_CACHE`), they are kept there.

    Tests that are started in the background, or under nohup, begin with signals ignored, and so do
    their subprocesses: here they are as in a terminal.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    if not hasattr(config, "workerinput"):
        if hasattr(config, "cache"):
            kept = str(config.cache.mkdir("compiled"))
        else:  # -p no:cacheprovider
            kept = tempfile.mkdtemp(prefix="sparse_coord_compiled_")
            config.add_cleanup(lambda: shutil.rmtree(kept, ignore_errors=True))
        os.environ.setdefault(FOLDER_VARIABLE, kept)
        os.environ.setdefault("NUMBA_CACHE_DIR", os.environ[FOLDER_VARIABLE])
        os.environ["HYPOTHESIS_STORAGE_DIRECTORY"] = f"{kept}/hypothesis"


@pytest.fixture(scope="session")
def python():
    """Return a function that runs Python in a process of its own and returns what it did.

    Unless its exit code is the one awaited, the test fails. It finds what this process finds.
    """

    def run(*arguments, cwd=None, env=None, code=0):
        path = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        done = subprocess.run(
            [sys.executable, *map(str, arguments)],
            cwd=cwd,
            env={**os.environ, **path, **(env or {})},
            capture_output=True,
            text=True,
            timeout=PATIENCE_SECONDS,
        )
        assert done.returncode == code, done.stderr
        assert "Traceback" not in done.stderr
        return done

    return run


@pytest.fixture
def make():
    """Return a maker of scenarios: `teams.drawn`."""
    return drawn


def pytest_collection_modifyitems(config, items):
    """Let pytest-xdist hand out files of nodes, which wait, in turn with those that compute."""
    if not hasattr(config, "workerinput"):
        return
    files = [list(group) for _, group in groupby(items, key=lambda item: item.path)]
    waiting = [file for file in files if file[0].path.parent.name == "nodes"]
    computing = [file for file in files if file not in waiting]
    each = len(computing) // max(1, len(waiting)) + 1
    items.clear()
    while waiting or computing:
        for file in waiting[:1] + computing[:each]:
            items += file
        del waiting[:1], computing[:each]


def pytest_collection_finish():
    """Let the garbage collector forget what lives to the end anyway: modules and tests."""
    gc.freeze()
