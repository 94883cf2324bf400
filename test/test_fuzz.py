# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files with a few changes are read, or refused in one line."""

import re
import shutil

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import LONGEST_LINE, SparseCoordError
from sparse_coord_ros.base.share import share_file
from sparse_coord_ros.core.game.grid import load_map
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.history import load_history
from sparse_coord_ros.core.runs.run_config import load_run
from sparse_coord_ros.core.runs.saved_tables import load_team
from sparse_coord_ros.log.runlog import verify

pytestmark = pytest.mark.long
many = settings(
    max_examples=1000,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
few = settings(many, max_examples=100)

PLACES = st.floats(0, 1, exclude_max=True)
"""A share of a file or of its lines."""

VALUES = st.sampled_from(
    "~ [] {} -1 0 1 1e9 .nan .inf yes 010 'a' [1,2] {start:1} env1 2020-01-01 &a".split()
)
"""What may stand in place of a value."""


@st.composite
def lines_changes(draw):
    """Return what changes some lines of a text: one value, or a line is doubled or left out."""
    changes = draw(
        st.lists(st.tuples(PLACES, st.integers(0, 3), VALUES), min_size=1, max_size=3)
    )

    def change(data):
        lines = data.decode().split("\n")
        for place, kind, value in changes:
            at = int(place * len(lines))
            line = lines[at]
            lines[at : at + 1] = [
                [re.sub(r"(?<=: ).+", value, line)],
                [re.sub(r"-?\d+", value, line, count=1)],
                [line, line],
                [],
            ][kind]
        return "\n".join(lines or [""]).encode()

    return change


@st.composite
def bytes_changes(draw):
    """Return what changes some bytes, or cuts the data off."""
    bytes_ = draw(st.lists(st.tuples(PLACES, st.integers(0, 255)), max_size=4))
    end = draw(st.just(1.0) | PLACES)

    def change(data):
        found = bytearray(data[: int(end * len(data))])
        for place, value in bytes_ if found else ():
            found[int(place * len(found))] = value
        return bytes(found)

    return change


def is_read_or_refused(path, change, read):
    """Change a file, read it, and write it as it was."""
    data = path.read_bytes()
    path.write_bytes(change(data))
    try:
        read()
    except SparseCoordError as error:
        line = str(error)
        assert line.isprintable() and len(line) < LONGEST_LINE + 50
    finally:
        path.write_bytes(data)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return the directory of a trained run."""
    folder = tmp_path_factory.mktemp("fuzz") / "run"
    scenario = sc.load_scenario("env1", steps=300)
    sc.train(scenario, engine="python").save(folder)
    return folder


@pytest.fixture(scope="module")
def texts(tmp_path_factory):
    """Return a folder with a scenario and its map."""
    folder = tmp_path_factory.mktemp("fuzz")
    shutil.copy(share_file("config", "env1.yaml"), folder)
    shutil.copy(share_file("maps", "env1.txt"), folder)
    return folder


@many
@given(lines_changes() | bytes_changes())
def test_scenario(texts, change):
    path = texts / "env1.yaml"
    is_read_or_refused(path, change, lambda: load_scenario(path))


@many
@given(lines_changes() | bytes_changes())
def test_map(texts, change):
    path = texts / "env1.txt"
    is_read_or_refused(path, change, lambda: load_map(str(path)))


@many
@given(lines_changes() | bytes_changes())
def test_run(run, change):
    is_read_or_refused(run / "run.yaml", change, lambda: load_run(run))


@many
@given(bytes_changes())
def test_tables_and_history(run, change):
    config = load_run(run)
    is_read_or_refused(
        run / "tables.npz", change, lambda: load_team(run, config.scenario, config.rule)
    )
    is_read_or_refused(run / "history.npz", change, lambda: load_history(run))


@few
@given(bytes_changes())
def test_bag(good, change):
    [path] = good.bag.glob("*.mcap")
    is_read_or_refused(path, change, lambda: verify(good.bag))
