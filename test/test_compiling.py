# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled loops on disk: found again, left alone by other sources, thrown away where spoiled."""

import importlib
import os
import subprocess
import sys

import pytest

from sparse_coord_ros.base import compiling
from sparse_coord_ros.base.compiling import has_numba

pytestmark = pytest.mark.skipif(not has_numba(), reason="numba is not installed")

PROGRAM = """
import time
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.engine.batch import is_prepared, prepare, run_batch
from sparse_coord_ros.core.runs.tables import pack_tables
import hashlib
scenario = load_scenario("env1", ).with_settings({"steps": 3000})
there = is_prepared()
prepare("coop")
[run] = run_batch(scenario, "coop", [4], trials=3, engine="numba")
bits = pack_tables({k: one.memory for k, one in enumerate(run.tables, 1)})
print(there, hashlib.sha256(bits).hexdigest(), run.measures.returns.tolist())
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder of the test's own to keep loops in."""
    monkeypatch.setenv(compiling.FOLDER_VARIABLE, str(tmp_path))
    compiling.folder.cache_clear()
    yield tmp_path
    compiling.folder.cache_clear()


def said(folder):
    """Return what a process of its own says: whether loops were there, and what it computed."""
    command = [sys.executable, "-W", "error", "-c", PROGRAM]
    env = os.environ | {compiling.FOLDER_VARIABLE: str(folder)}
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stderr) == (0, "")
    there, _, computed = done.stdout.partition(" ")
    return there == "True", computed


@pytest.mark.long
def test_found_again_and_the_same_bits(tmp_path):
    there, computed = said(tmp_path)
    assert not there
    assert said(tmp_path) == (True, computed)
    spoiled = [path for path in tmp_path.rglob("*") if path.suffix in (".nbi", ".nbc")]
    assert len(spoiled) >= 4
    for place, path in enumerate(spoiled):  # one cut off, one foreign, one empty ...
        path.write_bytes((path.read_bytes()[:100], b"no pickle", b"")[place % 3])
    assert said(tmp_path) == (True, computed)
    assert all(path.stat().st_size > 1000 for path in tmp_path.rglob("*.nbc"))
    assert said("") == (False, computed)


def test_where_it_is(folder, monkeypatch):
    assert compiling.folder().parent == folder
    compiling.keep("tables")
    assert compiling.is_kept("tables") and not compiling.is_kept("factors")
    compiling.folder.cache_clear()
    # other versions
    monkeypatch.setattr(compiling, "COMPILER", (*compiling.COMPILER, "mcap"))
    assert not compiling.is_kept("tables")
    compiling.folder.cache_clear()
    monkeypatch.setattr(compiling, "SOURCES", ("cli/*.py",))  # other sources
    assert not compiling.is_kept("tables")
    assert len(list(folder.iterdir())) == 3


def test_a_changed_rule_compiles_anew(folder, monkeypatch):
    """Also one of the user's own, whose source is none of this package's."""
    code = "class Minds(tuple):\n    bootstrap = staticmethod(lambda: {})\n"
    places = set()
    monkeypatch.syspath_prepend(folder)
    for value in (1, 2):
        (folder / "own_rule.py").write_text(code.format(value))
        minds = importlib.import_module("own_rule").Minds
        compiling.folder.cache_clear()
        places |= {compiling.folder(minds), compiling.folder()}
        compiling.keep("Minds", minds)
        assert compiling.is_kept("Minds", minds) and not compiling.is_kept("Minds")
        del sys.modules["own_rule"]
    assert len(places) == 3


def test_what_is_spoiled_is_thrown_away(folder):
    assert not compiling.forget()
    compiling.keep("tables")
    (compiling.folder() / "engine").mkdir()
    assert compiling.forget()
    assert not list(compiling.folder().iterdir())


@pytest.mark.parametrize("how", ["empty", "a file", "no numba"])
def test_where_nothing_can_be_kept(folder, monkeypatch, how):
    if how == "empty":
        monkeypatch.setenv(compiling.FOLDER_VARIABLE, "")
    elif how == "a file":
        (folder / "file").touch()
        monkeypatch.setenv(compiling.FOLDER_VARIABLE, str(folder / "file"))
    else:
        monkeypatch.setattr(compiling, "COMPILER", ("no_such_package",))
    assert compiling.folder() is None
    compiling.keep("tables")
    assert not compiling.is_kept("tables")
    assert not compiling.forget()


def test_in_the_users_cache_unless_named(folder, monkeypatch):
    monkeypatch.delenv(compiling.FOLDER_VARIABLE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    assert compiling.folder().parent == folder / "cache" / "sparse_coord_ros"


def test_work_that_failed_is_done_again_and_work_that_is_done_is_not():
    tries = []

    def work():
        tries.append("try")
        if len(tries) == 1:
            raise MemoryError
        return 5

    with pytest.raises(MemoryError):
        compiling.in_background("test work", work)
    assert [compiling.in_background("test work", work) for _ in range(2)] == [5, 5]
    assert len(tries) == 2
