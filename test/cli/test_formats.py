# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every 2.x reads and goes on with the files of 2.0.0 (made by test/fixtures/make.py)."""

import io
import json
import lzma
import shutil
from pathlib import Path

import numpy as np
import pytest

FIXTURES = Path(__file__).parents[1] / "fixtures/2.0.0"
CONDITION = "env1/coop/penalty=-20,steps=300"
FEW = ("--runs", 2, "--trials", 5)
SEARCH = ("optimum", "doorway.yaml", "--class", "--restarts", 3, "--out")


@pytest.fixture
def files(folder):
    """Work in a folder that has the files."""
    shutil.copytree(FIXTURES, folder, dirs_exist_ok=True)
    packed = folder / "bag_0.mcap.xz"
    (folder / "bag_0.mcap").write_bytes(lzma.decompress(packed.read_bytes()))
    return folder


def arrays(path):
    with np.load(path) as file:
        return {name: file[name] for name in file.files if name != "format"}


def same(path, other):
    found = arrays(path)
    due = arrays(other)
    assert found.keys() == due.keys()
    for name in due:
        np.testing.assert_array_equal(found[name], due[name], strict=True)


def test_tables_and_history_are_what_is_learned_today(sparse_coord, files):
    assert sparse_coord("train", "doorway.yaml", "--seed", 3, "--out", "today")[0] == 0
    for name in ("tables.npz", "history.npz"):
        same(files / "today" / name, files / "trained" / name)
    measures = [
        sparse_coord("evaluate", name, "--exact", "--json")
        for name in ("today", "trained")
    ]
    assert measures[0][0] == 0 and measures[0][1] == measures[1][1].replace(
        "trained", "today"
    )
    assert sparse_coord("plot", "trained", "--what", "length", "--out", "x.png")[0] == 0


def test_tables_of_another_learner_are_what_is_learned_today(sparse_coord, files):
    command = (
        "train",
        "doorway.yaml",
        "--seed",
        3,
        "--learner",
        "cq",
        "--out",
        "today",
    )
    assert sparse_coord(*command)[0] == 0
    same(files / "today/tables.npz", files / "marked/tables.npz")
    assert sparse_coord("evaluate", "marked", "--exact")[0] == 0


def test_training_goes_on(sparse_coord, files):
    assert sparse_coord("train", "--resume", "begun")[0] == 0
    same(files / "begun/tables.npz", files / "trained/tables.npz")


def test_a_live_team_goes_on(python, files, own_domain):
    command = ("-m", "sparse_coord_ros.executables", "sparse_coord", "run")
    python(*command, "--resume", "interrupted", cwd=files)
    found, due = (
        arrays(files / name / "tables.npz") for name in ("interrupted", "trained")
    )
    assert found.keys() == due.keys()
    for name in set(due) - {"format"}:
        np.testing.assert_array_equal(found[name], due[name])


def test_a_bag_is_computed_again(sparse_coord, files):
    code, out, _ = sparse_coord("verify", "bag_0.mcap")
    assert code == 0 and "\nidentical: " in out


def test_results_are_what_is_computed_today(sparse_coord, files):
    kept = files / "results/conditions" / f"{CONDITION}.json"
    before = kept.stat().st_mtime_ns
    for name in ("results", "today"):
        assert sparse_coord("reproduce", CONDITION, *FEW, "--out", name)[0] == 0
    assert kept.stat().st_mtime_ns == before
    today = files / "today/conditions" / f"{CONDITION}.json"
    assert json.loads(today.read_text()) == json.loads(kept.read_text())


def test_a_search_is_what_is_found_today(sparse_coord, files):
    before = (files / "search.json").read_bytes()
    for name in ("search.json", "today.json"):
        assert sparse_coord(*SEARCH, name)[0] == 0
    assert (
        (files / "today.json").read_bytes()
        == (files / "search.json").read_bytes()
        == before
    )


READ = {
    "trained/run.yaml": ("evaluate", "trained"),
    "trained/tables.npz": ("evaluate", "trained"),
    "trained/history.npz": ("plot", "trained", "--what", "length", "--out", "x.png"),
    "begun/checkpoint.npz": ("train", "--resume", "begun"),
    "interrupted/run.yaml": ("run", "--resume", "interrupted"),
    "bag_0.mcap": ("verify", "bag_0.mcap"),
    "results/results.json": ("reproduce", CONDITION, *FEW, "--out", "results"),
    f"results/conditions/{CONDITION}.json": ("plot", "results", "--out", "x.png"),
    "search.json": (*SEARCH, "search.json"),
}
"""A verb that reads each file."""


def number_of(name):
    """Return the number of a file's format."""
    return 1 if name == "search.json" else 4


def renumbered(path, known, number):
    """Give a file another number of its format."""
    data = path.read_bytes()
    if path.suffix == ".npz":
        with np.load(io.BytesIO(data)) as file:
            found = dict(file)
        found["format"][0] = f"{number}"
        np.savez(path, **found)
    elif path.suffix == ".mcap":
        head = b"format\x01\0\0\x00"
        first, other = (head + b"%d" % one for one in (known, number))
        assert data.count(first) == 1
        path.write_bytes(data.replace(first, other))
    else:
        text = data.decode()
        key = 'format": ' if path.suffix == ".json" else "format: "
        assert f"{key}{known}" in text
        path.write_text(text.replace(f"{key}{known}", f"{key}{number}", 1))


@pytest.mark.parametrize("name", READ)
@pytest.mark.parametrize(
    ("more", "remedy"), [(1, "update sparse_coord_ros"), (-1, "make it anew")]
)
def test_another_number_is_one_line(files, refused, name, more, remedy):
    known = number_of(name)
    renumbered(files / name, known, known + more)
    said = f"{name}: is in format {known + more}, this version reads format {known}; {remedy}"
    assert said in refused(*READ[name])


@pytest.mark.parametrize("name", READ)
def test_a_damaged_file_is_one_line(files, refused, name):
    path = files / name
    path.write_bytes(path.read_bytes()[: 20 if path.suffix == ".mcap" else -40])
    assert path.name in refused(*READ[name])
