# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled loops on disk: found again, left alone by other sources, thrown away where spoiled."""

import os
import subprocess
import sys

import pytest

from sparse_coord_ros import kept
from sparse_coord_ros.compiling import has_numba

pytestmark = pytest.mark.skipif(not has_numba(), reason="numba is not installed")

PROGRAM = """
import time
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.engine.batch import is_prepared, prepare, run_batch
from sparse_coord_ros.learn.tables import pack_tables
import hashlib
scenario = load_scenario("env1", ).with_settings({"steps": 3000})
there = is_prepared()
prepare(scenario, "coop")
[run] = run_batch(scenario, "coop", [4], trials=3, engine="numba")
bits = pack_tables(dict(enumerate(run.tables, 1)))
print(there, hashlib.sha256(bits).hexdigest(), run.trials.reward.tolist())
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder of the test's own to keep loops in."""
    monkeypatch.setenv(kept.FOLDER_VARIABLE, str(tmp_path))
    kept.folder.cache_clear()
    yield tmp_path
    kept.folder.cache_clear()


def said(folder):
    """Return what a process of its own says: whether loops were there, and what it computed."""
    command = [sys.executable, "-W", "error", "-c", PROGRAM]
    env = os.environ | {kept.FOLDER_VARIABLE: str(folder)}
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
    assert kept.folder().parent == folder
    kept.keep("tables")
    assert kept.is_kept("tables") and not kept.is_kept("factors")
    kept.folder.cache_clear()
    monkeypatch.setattr(kept, "COMPILER", (*kept.COMPILER, "mcap"))  # other versions
    assert not kept.is_kept("tables")
    kept.folder.cache_clear()
    monkeypatch.setattr(kept, "SOURCES", ("core",))  # other sources
    assert not kept.is_kept("tables")
    assert len(list(folder.iterdir())) == 3


def test_what_is_spoiled_is_thrown_away(folder):
    assert not kept.forget()
    kept.keep("tables")
    (kept.folder() / "engine").mkdir()
    assert kept.forget()
    assert not list(kept.folder().iterdir())


@pytest.mark.parametrize("how", ["empty", "a file", "no numba"])
def test_where_nothing_can_be_kept(folder, monkeypatch, how):
    if how == "empty":
        monkeypatch.setenv(kept.FOLDER_VARIABLE, "")
    elif how == "a file":
        (folder / "file").touch()
        monkeypatch.setenv(kept.FOLDER_VARIABLE, str(folder / "file"))
    else:
        monkeypatch.setattr(kept, "COMPILER", ("no_such_package",))
    assert kept.folder() is None
    kept.keep("tables")
    assert not kept.is_kept("tables")
    assert not kept.forget()


def test_in_the_users_cache_unless_named(folder, monkeypatch):
    monkeypatch.delenv(kept.FOLDER_VARIABLE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    assert kept.folder().parent == folder / "cache" / "sparse_coord_ros"
