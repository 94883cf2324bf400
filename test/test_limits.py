# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What comes from elsewhere is read within limits, or refused in one line."""

import math
import os
import re
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sparse_coord_ros.base.errors import MapError, ScenarioError, SparseCoordError
from sparse_coord_ros.base.limits import DEEPEST_NESTING, Limit, read_file, read_text
from sparse_coord_ros.base.yaml_text import parse_yaml, to_yaml
from sparse_coord_ros.core.game.grid import load_map
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.history import load_history
from sparse_coord_ros.core.runs.run_config import load_run
from sparse_coord_ros.core.runs.tables import load_saved
from sparse_coord_ros.lab.maps.image import read_floor_plan
from sparse_coord_ros.studies.store import read_results

SMALL = Limit("a test", 1000, 40)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("010", 10),
        ("0o17", 15),
        ("0x1F", 31),
        ("-7", -7),
        ("1:1:1", "1:1:1"),
        ("1_000", "1_000"),
        ("1e3", 1000.0),
        (".5", 0.5),
        ("5.", 5.0),
        ("-.inf", -math.inf),
        ("7" * 500, math.inf),
        ("yes", "yes"),
        ("on", "on"),
        ("Off", "Off"),
        ("TRUE", True),
        ("false", False),
        ("~", None),
        ("", None),
        ("2020-13-45", "2020-13-45"),
        ("'1'", "1"),
        ('"true"', "true"),
        ("|\n  x\n  y\n", "x\ny\n"),
        ("[1, [2, {b: 3}]]", [1, [2, {"b": 3}]]),
    ],
)
def test_yaml_is_that_of_version_1_2(text, value):
    found = parse_yaml(f"a: {text}", where="")["a"]
    assert (found, type(found)) == (value, type(value))


@pytest.mark.parametrize(
    "text",
    [
        "a: \ud800\n",
        "a: " + "[" * DEEPEST_NESTING + "]" * DEEPEST_NESTING,
        "a: [" + "1," * 40 + "]",
        "a: " + 1000 * "x",
    ],
    ids=["no text", "too deep", "too many values", "too long"],
)
def test_what_is_not_read_is_told_in_one_line(text):
    with pytest.raises(MapError, match="^here") as error:
        parse_yaml(text, where="here", limit=SMALL, error=MapError)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "bomb", ["[" * 4_000_000, "{a: " * 1_000_000, "\n- 1" * 2_000_000]
)
def test_bombs_end_early(bomb):
    before = time.process_time()
    with pytest.raises(ScenarioError, match="^bomb"):
        parse_yaml(f"x: {bomb}", where="bomb")
    assert time.process_time() - before < 1.0


def test_shared_parts_are_written_out():
    part = [1, 2]
    assert parse_yaml(to_yaml({"a": part, "b": part}), where="") == {
        "a": part,
        "b": part,
    }


LIKE_OTHERS = "1e3 12e45 0o7 0x1f 1.5 yes 010 2020-01-01 1:1 .5 +1 ~ true .inf 1_000 <<"
TEXTS = st.text(st.characters(codec="utf-8"))
KEYS = st.text("abcxyz_ 12:-", min_size=1)
PLAIN = st.one_of(
    st.sampled_from(["", "a: b", *LIKE_OTHERS.split()]),
    TEXTS,
    st.integers(),
    st.floats(allow_nan=False),
    st.sampled_from([True, False, None]),
)


@given(
    st.recursive(
        PLAIN,
        lambda inner: st.lists(inner) | st.dictionaries(KEYS, inner),
        max_leaves=8,
    )
)
def test_what_is_written_is_read_back(value):
    found = parse_yaml(to_yaml({"k": value}), where="")["k"]
    assert repr(found) == repr(value)


def test_regular_files_only(tmp_path):
    file = tmp_path / "file"
    pipe = tmp_path / "pipe"
    file.write_bytes(b"a\r\nb")
    os.mkfifo(pipe)
    (tmp_path / "link").symlink_to(file)
    how = {"limit": SMALL, "error": MapError, "remedy": "give another"}
    assert read_file(file, **how) == b"a\r\nb"
    assert read_text(tmp_path / "link", **how) == "a\nb"
    for path, words in (
        (pipe, "it is not a file"),
        (Path(os.devnull), "it is not a file"),
        (tmp_path, "Is a directory"),
        (tmp_path / "none", "No such file"),
    ):
        with pytest.raises(MapError, match=words) as error:
            read_file(path, **how)
        assert str(error.value).startswith(f"{path}: cannot be read (")
    file.write_bytes(b"\xff")
    with pytest.raises(MapError, match="UTF-8"):
        read_text(file, **how)


def test_large_files_are_not_read(tmp_path):
    large = tmp_path / "large"
    with large.open("wb") as file:
        file.truncate(2**40)
    words = "it has 1,099,511,627,776 bytes, allowed for a test: 1,000"
    with pytest.raises(MapError, match=re.escape(words)):
        read_file(large, SMALL, MapError, "")


def drawn(robots, rows=30, columns=100):
    """Return the text of a scenario with so many robots on a map with so many cells beside it."""
    cells = [f"[{k // columns}, {k % columns}]" for k in range(robots + 1)]
    lines = (
        f"  r{k}: {{start: {cells[k]}, goal: {cells[k + 1]}}}\n" for k in range(robots)
    )
    grid = "title: x\n---\n" + ("." * columns + "\n") * rows
    return "map: m.txt\nrobots:\n" + "".join(lines), grid


@pytest.mark.parametrize(
    ("robots", "rows", "columns", "words"),
    [
        (
            20_000,
            1000,
            30,
            "here are more than 20,000 values, allowed for a scenario or a run",
        ),
        (
            2,
            10_000,
            1000,
            "m.txt: cannot be read .it has 10,010,013 bytes, allowed for a map: ",
        ),
        (
            2,
            1001,
            1000,
            "has 1,001,000 cells and walls, allowed: 1,000,000; use larger cells",
        ),
        pytest.param(53, 1000, 1000, "", marks=pytest.mark.long),
    ],
    ids=["20,000 robots", "10 million cells", "too many cells", "as large as may be"],
)
def test_large_scenarios_are_read_or_refused_soon(
    tmp_path, robots, rows, columns, words
):
    text, grid = drawn(robots, rows, columns)
    (tmp_path / "m.txt").write_text(grid)
    (tmp_path / "s.yaml").write_text(text)
    before = time.process_time()
    if words:
        with pytest.raises((MapError, ScenarioError), match=words) as error:
            load_scenario(tmp_path / "s.yaml")
        assert "\n" not in str(error.value)
    else:
        assert len(load_scenario(tmp_path / "s.yaml").robots) == robots
    assert time.process_time() - before < 5.0


@pytest.mark.parametrize("kind", ["pipe", "folder", "200 MB"])
@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("tables.npz", lambda at: load_saved(at, [1])),
        ("history.npz", lambda at: load_history(at.parent)),
        ("run.yaml", lambda at: load_run(at.parent)),
        ("scenario.yaml", load_scenario),
        ("map.txt", lambda at: load_map(str(at))),
        ("map.yaml", read_floor_plan),
        ("image.png", lambda at: read_floor_plan(at.parent / "plan.yaml")),
        ("results.json", lambda at: read_results(at.parent)),
    ],
)
def test_what_is_no_regular_file_of_a_size_is_refused_at_once(
    tmp_path, name, read, kind
):
    (tmp_path / "plan.yaml").write_text("image: image.png\nresolution: 0.1\n")
    path = tmp_path / name
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        with path.open("wb") as file:
            file.truncate(200_000_000)
    before = time.process_time()
    with pytest.raises(SparseCoordError) as error:
        read(path)
    assert "\n" not in str(error.value)
    assert name in str(error.value) or f"{path.parent}" in str(error.value)
    assert time.process_time() - before < 5.0
