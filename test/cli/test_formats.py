# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files in another format are refused by their number alone; damaged files are refused, too."""

import json
from contextlib import closing
from types import SimpleNamespace

import numpy as np
import pytest
from recordings import write_run

from sparse_coord_ros.base.version import FORMAT, __version__
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.log.bags import BagWriter
from sparse_coord_ros.studies.checked_json import to_text

OTHER = FORMAT - 1
CONDITION = "env1/coop/penalty=-20,steps=300"
RESULT = f"results/conditions/{CONDITION}.json"
REPRODUCE = ("reproduce", CONDITION, "--runs", 2, "--trials", 5, "--out", "results")
SEARCH = ("optimum", "env1", "--class", "--restarts", 3, "--out", "search.json")

READ = {
    "trained/run.yaml": ("evaluate", "trained"),
    "trained/tables.npz": ("evaluate", "trained"),
    "trained/history.npz": ("plot", "trained", "--what", "curves", "--out", "x.png"),
    "begun/checkpoint.npz": ("train", "--resume", "begun"),
    "bag/bag_0.mcap": ("verify", "bag/bag_0.mcap"),
    "results/results.json": REPRODUCE,
    RESULT: ("plot", "results", "--out", "x.png"),
    "search.json": SEARCH,
}
"""A verb that reads each file."""


def run_text():
    return make_run(load_scenario("env1"), {"seed": 3}).to_yaml()


@pytest.fixture
def files(folder):
    """Work in a folder that has the files, in the other format; they hold little more."""
    for name in READ:
        path = folder / name
        if name != "bag/bag_0.mcap":
            path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".npz":
            np.savez(path, format=np.array(OTHER))
        if path.suffix == ".json":
            path.write_text(json.dumps({"format": OTHER}))
    text = run_text()
    assert f"format: {FORMAT}\n" in text
    other = text.replace(f"format: {FORMAT}\n", f"format: {OTHER}\n")
    (folder / "trained/run.yaml").write_text(other)
    with closing(BagWriter(folder / "bag")) as bag:
        write_run(bag, SimpleNamespace(to_yaml=lambda: other))
    return folder


def renew_what_is_read_before(files, name):
    """Put files of this format where a verb reads them before the named one."""
    if name.endswith(".npz"):
        (files / name).with_name("run.yaml").write_text(run_text())
    if name == RESULT:
        plan = {"version": __version__, "seed": 0, "runs": 2, "trials": 5}
        (files / "results/results.json").write_text(to_text(plan))


@pytest.mark.parametrize("name", READ)
def test_a_file_in_another_format_is_one_line(files, refused, name):
    renew_what_is_read_before(files, name)
    said = f"is in format {OTHER}, this version reads format {FORMAT}; make it anew"
    assert f"{name}: {said}" in refused(*READ[name])


@pytest.mark.parametrize("name", READ)
def test_a_damaged_file_is_one_line(files, refused, name):
    renew_what_is_read_before(files, name)
    path = files / name
    path.write_bytes(path.read_bytes()[: 20 if path.suffix == ".mcap" else -10])
    assert path.name in refused(*READ[name])
