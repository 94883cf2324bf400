# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files in the format of version 2.0.0 (test/fixtures/2.0.0), and damaged ones, are refused."""

import lzma
import shutil
from pathlib import Path

import pytest

from sparse_coord_ros.base.version import FORMAT, __version__
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.studies.checked_json import to_text

FIXTURES = Path(__file__).parents[1] / "fixtures/2.0.0"
CONDITION = "env1/coop/penalty=-20,steps=300"
RESULT = f"results/conditions/{CONDITION}.json"
REPRODUCE = ("reproduce", CONDITION, "--runs", 2, "--trials", 5, "--out", "results")
SEARCH = ("optimum", "doorway.yaml", "--class", "--restarts", 3, "--out", "search.json")

READ = {
    "trained/run.yaml": ("evaluate", "trained"),
    "trained/tables.npz": ("evaluate", "trained"),
    "trained/history.npz": ("plot", "trained", "--what", "length", "--out", "x.png"),
    "begun/checkpoint.npz": ("train", "--resume", "begun"),
    "bag_0.mcap": ("verify", "bag_0.mcap"),
    "results/results.json": REPRODUCE,
    RESULT: ("plot", "results", "--out", "x.png"),
    "search.json": SEARCH,
}
"""A verb that reads each file."""


@pytest.fixture
def files(folder):
    """Work in a folder that has the files."""
    shutil.copytree(FIXTURES, folder, dirs_exist_ok=True)
    packed = folder / "bag_0.mcap.xz"
    (folder / "bag_0.mcap").write_bytes(lzma.decompress(packed.read_bytes()))
    return folder


def renew_what_is_read_before(files, name):
    """Put files of this version where a verb reads them before the named one."""
    if name.endswith(".npz"):
        run = make_run(load_scenario("doorway.yaml"), {"seed": 3})
        (files / name).with_name("run.yaml").write_text(run.to_yaml())
    if name == RESULT:
        plan = {"version": __version__, "seed": 0, "runs": 2, "trials": 5}
        (files / "results/results.json").write_text(to_text(plan))


@pytest.mark.parametrize("name", READ)
def test_a_file_of_2_0_0_is_one_line(files, refused, name):
    renew_what_is_read_before(files, name)
    known = 1 if name == "search.json" else 4
    said = f"{name}: is in format {known}, this version reads format {FORMAT}; make it anew"
    assert said in refused(*READ[name])


@pytest.mark.parametrize("name", READ)
def test_a_damaged_file_is_one_line(files, refused, name):
    renew_what_is_read_before(files, name)
    path = files / name
    path.write_bytes(path.read_bytes()[: 20 if path.suffix == ".mcap" else -40])
    assert path.name in refused(*READ[name])
