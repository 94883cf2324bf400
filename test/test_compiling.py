# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled loops on disk: found again, left alone by other sources, thrown away where spoiled."""

import importlib
import os
import subprocess
import sys
import time

import pytest

from sparse_coord_ros.base import compiling
from sparse_coord_ros.base.compiling import has_numba

pytestmark = pytest.mark.skipif(not has_numba(), reason="numba is not installed")

PROGRAM = """
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.engine.batch import is_prepared, prepare, run_batch
from sparse_coord_ros.core.runs.saved_tables import pack_tables
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
    assert done.returncode == 0
    there, _, computed = done.stdout.partition(" ")
    assert ("compiling learner coop" in done.stderr) == (there == "False")
    assert done.stderr.count("\n") == (there == "False")
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


def test_loops_that_nobody_used_for_long_are_deleted(folder):
    old = folder / ("a" * 16)
    used = folder / ("b" * 16)
    other = folder / "mine"
    long_ago = time.time() - compiling.UNUSED_SECONDS - 10
    for path, when in ((old, long_ago), (used, time.time()), (other, long_ago)):
        path.mkdir()
        (path / "loop.nbc").touch()
        os.utime(path, (when, when))
    ours = compiling.folder()
    assert sorted(folder.iterdir()) == sorted([ours, used, other])


OWN_RULE = """
import more
from more import WEIGHT, twice

class Rule:
    @staticmethod
    def bootstrap(value):
        return twice(value) * WEIGHT + more.SHARE
"""
MORE = """
from rest import TABLE, NUMBER

SHARE = 0.5
WEIGHT = 1.0
def twice(value):
    return 2 * value + TABLE[0]
"""
REST = """
import numpy as np
TABLE = np.zeros(3)
NUMBER = 0
"""
OWN_FILES = {"own_rule": OWN_RULE, "more": MORE, "rest": REST}


def own_folder(place):
    """Return the folder of the user's own rule, whose files lie in this place."""
    for name in OWN_FILES:
        sys.modules.pop(name, None)
    importlib.invalidate_caches()
    compiling.folder.cache_clear()
    return compiling.folder(importlib.import_module("own_rule").Rule)


@pytest.mark.parametrize(
    ("name", "before", "after", "anew"),
    [
        ("own_rule", "* WEIGHT", "/ WEIGHT", True),
        ("more", "2 * value", "3 * value", True),
        ("more", "SHARE = 0.5", "SHARE = 0.25", True),
        ("more", "WEIGHT = 1.0", "WEIGHT = 2.0", True),
        ("rest", "zeros(3)", "ones(3)", True),
        ("rest", "NUMBER = 0", "NUMBER = 1", False),  # no function reads it
    ],
)
def test_what_the_user_changes_is_compiled_anew(
    folder, tmp_path_factory, monkeypatch, name, before, after, anew
):
    """Numba looks only at the file of the loop, which is this package's."""
    place = tmp_path_factory.mktemp("own")
    monkeypatch.syspath_prepend(place)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    for one, code in OWN_FILES.items():
        (place / f"{one}.py").write_text(code)
    first = own_folder(place)
    assert own_folder(place) == first != compiling.folder()
    assert before in OWN_FILES[name]
    (place / f"{name}.py").write_text(OWN_FILES[name].replace(before, after))
    assert (own_folder(place) != first) == anew
    for one in OWN_FILES:
        del sys.modules[one]


OWN_LEARNER = """
import sparse_coord_ros as sc
from own_helper import shifted

learn_as_coop = sc.Coop.learn

class Shifted(sc.Coop):
    @staticmethod
    def learn(mind, task, k, now, after):
        learn_as_coop(mind, task, k, now, shifted(after))
"""
OWN_HELPER = """
import sparse_coord_ros as sc

@sc.rules.jitable
def shifted(value):
    return value + 0.5
"""
TRAIN_OWN = """
import sparse_coord_ros as sc
for engine in ("numba", "python"):
    scenario = sc.load_scenario("env1", steps=500)
    team = sc.train(scenario, "own_learner:Shifted", engine=engine)
    print(repr(float(team.tables[0].q_star.sum())))
"""


@pytest.mark.long
@pytest.mark.parametrize("name", ["own_learner", "own_helper"])
def test_a_learner_that_was_changed_learns_what_plain_python_does(
    tmp_path, python, name
):
    files = {"own_learner": OWN_LEARNER, "own_helper": OWN_HELPER}
    for one, code in files.items():
        (tmp_path / f"{one}.py").write_text(code)
    env = {compiling.FOLDER_VARIABLE: str(tmp_path / "kept")}
    sums = []
    for _ in range(2):
        done = python("-c", TRAIN_OWN, cwd=tmp_path, env=env)
        compiled, plain = done.stdout.split()
        assert compiled == plain
        assert "compiling learner own_learner:Shifted" in done.stderr
        sums.append(plain)
        changed = files[name].replace("value + 0.5", "value + 1.5")
        changed = changed.replace("shifted(after)", "shifted(2 * after)")
        (tmp_path / f"{name}.py").write_text(changed)
    assert sums[0] != sums[1]


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
