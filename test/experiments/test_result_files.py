# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A result file that is damaged, or of something else, is refused in one line."""

import json
import shutil

import pytest

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import ResultsError
from sparse_coord_ros.base.version import FORMAT
from sparse_coord_ros.cli.main import main
from sparse_coord_ros.studies.checked_json import to_text
from sparse_coord_ros.studies.conditions import parse_id
from sparse_coord_ros.studies.runner import run_experiment
from sparse_coord_ros.studies.store import (
    Plan,
    computation_digest,
    open_results,
    read_results,
)

COOP, NONCOOP = (
    f"env1/{learner}/penalty=-20,steps=100" for learner in ("coop", "noncoop")
)
PLAN = Plan(seed=5, runs=2, trials=3)
FEW = {"runs": PLAN.runs, "trials": PLAN.trials, "engine": "python", "jobs": 1}


def computed(folder, seed=PLAN.seed, **how):
    run_experiment([COOP, NONCOOP], out=folder, seed=seed, **{**FEW, **how})
    return folder


def file_of(folder, condition=COOP):
    return folder / "conditions" / f"{condition}.json"


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    return computed(tmp_path_factory.mktemp("original") / "r")


@pytest.fixture
def folder(original, tmp_path):
    """Return a results directory that may be damaged."""
    return shutil.copytree(original, tmp_path / "r")


def is_refused(folder, capsys, name):
    """Check that all refuse it, and leave it as it is; return the one line."""
    before = {path: path.read_bytes() for path in folder.rglob("*.json")}
    with pytest.raises(ResultsError) as caught:
        read_results(folder)
    line = str(caught.value)
    assert name in line and "\n" not in line
    assert main(["plot", str(folder), "--out", str(folder.parent / "x.png")]) == 2
    assert capsys.readouterr() == ("", f"error: {line}\n")
    with pytest.raises(ResultsError, match=name):
        run_experiment([COOP], out=folder, seed=PLAN.seed, **FEW)
    assert {path: path.read_bytes() for path in folder.rglob("*.json")} == before
    return line


DAMAGES = {
    "truncated": lambda text: text[:-40],
    "empty": lambda text: "",
    "a list": lambda text: "[]",
    "no UTF-8": lambda text: "\udcff" + text,
    "no format": lambda text: text.replace(f'"format": {FORMAT}, ', ""),
    "no plan": lambda text: text.replace('"plan"', '"plans"'),
    "text for a number": lambda text: text.replace(
        '"optimum": ', '"optimum": "1", "x": '
    ),
    "number for a list": lambda text: text.replace(
        '"visited": [', '"visited": 3, "x": ['
    ),
    "three runs": lambda text: text.replace('"visited": [', '"visited": [1, '),
    "no returns": lambda text: text.replace('"returns"', '"return"', 1),
    "a source of its own": lambda text: text.replace('"exact"', '"guessed"'),
    "a variance of nothing": lambda text: text.replace(
        '"variances": {', '"variances": {"laps": [1, 1], '
    ),
}


@pytest.mark.parametrize("change", DAMAGES.values(), ids=DAMAGES)
def test_damaged_files_are_refused(folder, capsys, change):
    path = file_of(folder)
    text = path.read_text()
    assert change(text) != text
    path.write_bytes(change(text).encode("utf-8", "surrogateescape"))
    is_refused(folder, capsys, path.name)


def test_it_is_computed_again_where_it_was_removed(folder, original):
    file_of(folder).unlink()
    run_experiment([COOP], out=folder, seed=PLAN.seed, **FEW)
    assert file_of(folder).read_bytes() == file_of(original).read_bytes()


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"seed": 17}, "computed with seed 17, this directory has seed 5"),
        ({"runs": 3}, "computed with runs 3, this directory has runs 2"),
        ({"trials": 4}, "computed with trials 4, this directory has trials 3"),
    ],
)
def test_a_file_of_another_plan_is_refused(folder, tmp_path, capsys, how, words):
    other = computed(tmp_path / "other", **how)
    shutil.copy(file_of(other), file_of(folder))
    shutil.rmtree(other)
    assert words in is_refused(folder, capsys, f"{COOP}.json")


def test_a_file_of_another_condition_is_refused(folder, capsys):
    shutil.copy(file_of(folder, NONCOOP), file_of(folder))
    is_refused(folder, capsys, f"{COOP}.json: was computed for another scenario")


@pytest.mark.parametrize(
    "change",
    [
        {"format": FORMAT - 1},
        {"seed": "5"},
        {"runs": 2.5},
        {"trials": None},
        {"fun": 1},
    ],
)
def test_a_changed_manifest_is_refused(folder, capsys, change):
    path = folder / "results.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    is_refused(folder, capsys, "results.json: ")


def test_numbers_that_are_none_are_not_written():
    with pytest.raises(ValueError, match="not JSON compliant"):
        to_text({"values": [float("nan")]})


OWN = """\
map: env1
robots:
  a: {start: 1, goal: 2}
  b: {start: 2, goal: 1}
steps: 100
"""


@pytest.fixture
def own(tmp_path):
    """Return a scenario of one's own, and results of it in two conditions."""
    (tmp_path / "mine.yaml").write_text(OWN)
    scenario = sc.load_scenario(tmp_path / "mine.yaml")
    over = {"penalty": [-5, -50], "learner": ["coop", "voi"]}
    found = sc.sweep(scenario, over, out=tmp_path / "r", seed=PLAN.seed, **FEW)
    return tmp_path / "r", found


def test_results_of_a_scenario_of_one_s_own_are_read_without_its_file(
    own, tmp_path, monkeypatch
):
    folder, found = own
    (tmp_path / "mine.yaml").unlink()
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    plan, results = read_results(folder)
    assert plan == PLAN
    assert {one.id: one for one in results} == dict(found)
    for (
        one
    ) in results:  # the learner's defaults hold again: they are not the scenario's own
        assert one.scenario == found[one.id].scenario
        assert computation_digest(one.condition) == computation_digest(
            found[one.id].condition
        )
    assert (
        main(["plot", str(folder), "--dpi", "30", "--out", str(tmp_path / "x.png")])
        == 0
    )


def test_a_scenario_of_one_s_own_has_one_place(own):
    folder, _ = own
    (folder / "conditions/mine").rename(folder / "conditions/other")
    with pytest.raises(ResultsError, match="its place is mine/coop/penalty=-5.json"):
        read_results(folder)


def test_another_scenario_of_the_same_name_is_refused_and_nothing_is_lost(
    own, tmp_path
):
    """It may be the work of hours, and whole: the user decides what becomes of it."""
    folder, _ = own
    before = {path: path.read_bytes() for path in folder.rglob("*.json")}
    (tmp_path / "mine.yaml").write_text(OWN.replace("steps: 100", "steps: 90"))
    with pytest.raises(ResultsError, match="another scenario.* not merged"):
        sc.sweep(
            str(tmp_path / "mine.yaml"), {"penalty": [-5]}, out=folder, seed=5, **FEW
        )
    assert {path: path.read_bytes() for path in folder.rglob("*.json")} == before


def test_a_condition_s_file_says_what_it_is_of(folder):
    condition = parse_id(COOP)
    content = json.loads(file_of(folder).read_text())
    assert (content["format"], content["scenario"]) == (FORMAT, None)
    assert content["plan"] == {"seed": 5, "runs": 2, "trials": 3}
    assert content["computation"] == computation_digest(condition)
    with open_results(folder, PLAN) as results:
        found = results.load(condition)
    measures = content["result"]["measures"]
    assert (found.measures.source, measures["source"]) == ("exact", "exact")
    assert found.measures.returns.tolist() == measures["returns"]
    assert found.seed == 5
