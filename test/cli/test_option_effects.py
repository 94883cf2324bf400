# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Options that no other test uses: each does what its help says."""

import json

import pytest
import yaml
from floor_plans import write_grid

from sparse_coord_ros.core.game.grid import parse_map

SHORT = ("train", "env1", "--steps", 300, "--trials", 0)


@pytest.fixture
def told(sparse_coord):
    """Return a function that runs a verb with --json and returns what it says."""

    def run(*words):
        code, out, err = sparse_coord(*words, "--json")
        assert code == 0, err
        return json.loads(out)

    return run


def test_starts_and_goals_change_the_optimum(told):
    """A robot that begins and ends elsewhere has another way."""
    values = {
        words: told("optimum", "env1", *words.split())["value"]
        for words in ("", "--start robot_1=4,3", "--goal robot_1=0,1")
    }
    near = values["--start robot_1=4,3"], values["--goal robot_1=0,1"]
    assert min(near) > values[""]


def test_a_search_has_its_seed_and_restarts(told):
    for seed, restarts in ((3, 1), (4, 2)):
        options = ("--restarts", restarts, "--seed", seed)
        found = told("optimum", "env1", "--class", *options)
        assert (found["seed"], found["restarts"]) == (seed, restarts)


@pytest.mark.long
def test_a_benchmark_of_some_lists_with_seeds_and_trials(told):
    few = ("--runs", 2, "--steps", 30, "--engine", "python", "--jobs", 1)
    words = ("benchmark", "noncoop", "--lists", "tuning-pairs", *few)
    runs = [told(*words, "--seed", seed) for seed in (1, 1, 2)]
    assert runs[0] == runs[1] != runs[2]
    assert "tuning-pairs" in json.dumps(runs[0])
    assert "tuning-four" not in json.dumps(runs[0])


def test_corridors_are_doorways_of_which_each_holds_one_robot(told, folder):
    grid = parse_map(
        "title: c\n---\n...###...\n.........\n...###...\n", name="c", where=""
    )
    write_grid(grid, folder)
    ends = ("--start", "0.5,1.5", "8.5,1.5", "--goal", "8.5,1.5", "0.5,1.5")
    words = ("import-map", folder / "c.yaml", "--cell", 1, "--radius", 0.2, *ends)
    doorways = {}
    for name, more in (("plain", ()), ("marked", ("--corridors",))):
        told(*words, *more, "--out", folder / name)
        [file] = (folder / name).glob("*.yaml")
        said = yaml.safe_load(file.read_text())
        [text] = (folder / name).glob("*.txt")
        doorways[name] = text.read_text().split("---\n")[1].count("D")
        assert (said.get("interactions") == "swap+block") == (name == "marked")
    assert doorways["marked"] >= 3 > doorways["plain"]


def test_a_greedy_film_is_drawn_from_its_seed(told, folder):
    told(*SHORT, "--set", "horizon=6", "--out", "run")
    films = []
    for seed in (1, 1, 2):
        told("animate", "run", "--greedy", "--seed", seed, "--out", f"{len(films)}.gif")
        films.append((folder / f"{len(films)}.gif").read_bytes())
    assert films[0] == films[1] != films[2]


def test_a_spread_is_that_of_robots_and_trials(told, sparse_coord):
    told(*SHORT, "--out", "run")
    said = told("evaluate", "run")
    _, out, _ = sparse_coord("evaluate", "run", "--spread")
    assert f"{said['returns_spread']:.2f}" in out and "s.d. of return" in out


@pytest.mark.parametrize("words", [(), ("--wait",), ("--loop", "--step")])
def test_replay_hands_on_its_options(sparse_coord, monkeypatch, words):
    seen = {}
    monkeypatch.setattr(
        "sparse_coord_ros.ros.nodes.spin.run_node", lambda make, _: make(None)
    )

    def player(context, values, keyboard):
        seen.update(values)
        return 0

    monkeypatch.setattr("sparse_coord_ros.ros.nodes.player.Player", player)
    assert sparse_coord("replay", "bag", *words)[0] == 0
    given = {name: seen[name] for name in ("wait", "loop", "start_paused")}
    assert given == {
        "wait": "--wait" in words,
        "loop": "--loop" in words,
        "start_paused": "--step" in words,
    }
