# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Without an extra all else works, and one line says what to install."""

import re
import xml.etree.ElementTree as ET
from contextlib import closing
from pathlib import Path

import pytest
from recordings import write_run

from sparse_coord_ros.base.errors import EXTRAS
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.log.bags import BagWriter

ROOT = Path(__file__).resolve().parents[1]

BARE = """
import sys
for name in ("matplotlib", "pandas", "aiohttp", "scipy", "PIL", "numba", "distributed",
             "pettingzoo", "gymnasium", "argcomplete"):
    sys.modules[name] = None  # importing it raises ImportError
import sparse_coord_ros as sc
from sparse_coord_ros.cli.main import main
"""

WORKS = """
import sparse_coord_ros.ros.nodes.team, sparse_coord_ros.ros.driving.driver
for name in sc.__all__:
    getattr(sc, name)
for line in ("maps env1", "optimum env1", "train env1 --steps 300 --out run", "evaluate run",
             "settings", "info bag"):
    assert main(line.split()) == 0, line
print(len(sc.run_experiment("env1/coop/penalty=-1,steps=100", runs=1, trials=1)), "condition")
"""

MISSING = {
    "plot run --out run.png": "plots",
    "animate run --out run.gif": "plots",
    "reproduce table1 --out results": "plots",
    "watch": "page",
    "run env1 --watch": "page",
    "train env1 --watch": "page",
    "import-map house.yaml --robots 2 --out house": "maps",
    "benchmark coop --scheduler tcp://127.0.0.1:1": "cluster",
}
"""Verbs, and the extra whose packages they need."""

CALLS = {
    "sc.train(sc.load_scenario('env1', steps=9)).history.to_pandas()": "plots",
    "sc.train_many(sc.load_scenario('env1', steps=9), runs=1, trials=0).plot()": "plots",
    "sc.pettingzoo_env('env1')": "pettingzoo",
    "sc.train_many('env1', runs=1, scheduler='tcp://127.0.0.1:1')": "cluster",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a bag."""
    folder = tmp_path_factory.mktemp("bare")
    with closing(BagWriter(folder / "bag")) as bag:
        write_run(bag, make_run(load_scenario("env1"), {}))
    return folder


def test_without_extras_one_line_says_what_to_install(python, folder):
    code = BARE + WORKS
    for verb in MISSING:
        code += f"assert main({verb.split()!r}) == 2\n"
    for call in CALLS:
        code += f"try: {call}\n"
        code += "except sc.SparseCoordError as error: print('error:', error, file=sys.stderr)\n"
        code += f"else: raise AssertionError({call!r})\n"
    done = python("-c", code, cwd=folder)
    assert "1 condition" in done.stdout
    said = re.findall("^error: .* pip install .*'(.*)'", done.stderr, re.M)
    assert said == [*MISSING.values(), *CALLS.values()]


def test_package_xml_names_what_setup_py_does():
    """Under the names of rosdep's keys; cluster and pettingzoo have none."""
    keys = {"PyYAML": "yaml", "pillow": "pil"}
    text = (ROOT / "setup.py").read_text()
    asked = re.search(r"install_requires=\[(.*?)\]", text, re.S)[1]
    for extra in ("fast", "plots", "page", "maps"):
        asked += re.search(rf'"{extra}": \[(.*?)\]', text)[1]
    names = re.findall(r'"([\w-]+)', asked)
    needed = {one.text for one in ET.parse(ROOT / "package.xml").iter("exec_depend")}
    for name in names:
        if not name.startswith("mcap"):
            assert f"python3-{keys.get(name, name).lower()}" in needed
    python = {name for name in needed if name.startswith("python3-")}
    assert len(python) == len([name for name in names if not name.startswith("mcap")])
    for extra, packages in EXTRAS.items():
        brings = re.search(rf'"{extra}": \[(.*?)\]', text)[1]
        assert all(package in brings or package == "gymnasium" for package in packages)
