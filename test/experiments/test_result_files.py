# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A result file that was damaged, edited or moved is never shown; who writes computes it again."""

import json
import shutil
import sys

import numpy as np
import pytest

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import ResultsError
from sparse_coord_ros.cli.main import main
from sparse_coord_ros.studies.checked_json import digest_of, to_text
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
def originals(tmp_path_factory):
    """Return directories of the same conditions: as they are, of other seeds, of more runs."""
    folder = tmp_path_factory.mktemp("originals")
    return {
        "as they are": computed(folder / "a"),
        "other seeds": computed(folder / "b", seed=17),
        "more runs": computed(folder / "c", runs=3),
        "more trials": computed(folder / "d", trials=4),
    }


@pytest.fixture
def folder(originals, tmp_path):
    """Return a results directory that may be damaged."""
    return shutil.copytree(originals["as they are"], tmp_path / "r")


def changed(value, *place, to):
    """Return plain data with one value changed; `place` leads there."""
    *path, last = place
    spot = value
    for key in path:
        spot = spot[key]
    spot[last] = to
    return value


def more(data, *place):
    """Return plain data with one more entry in a list, or in an object."""
    spot = data
    for key in place:
        spot = spot[key]
    if isinstance(spot, list):
        spot.append(spot[-1])
    else:
        spot["fun"] = 1.0
    return data


def less(data, *place):
    """Return plain data without an entry."""
    *path, last = place
    spot = data
    for key in path:
        spot = spot[key]
    del spot[last]
    return data


R = "result"
SUMS = ("returns", "time_to_goal", "asks", "miscoordinations")
NUMBERS = {
    **{
        f"{group} of {name}": (R, group, name, 1)
        for group in ("means", "variances")
        for name in SUMS
    },
    **{f"exact {name}": (R, "exact", name, 0) for name in (*SUMS, "arrived")},
    **{f"reference {name}": (R, "reference", name) for name in (*SUMS[:2], SUMS[3])},
    **{f"robots' {name}": (R, "robot_means", name, 1) for name in ("returns", "asks")},
    **{name: (R, name, 0) for name in ("not_arrived", "visited")},
    **{name: (R, name, 1, 4) for name in ("asked", "stays")},
    "optimum": (R, "optimum"),
    **{name: ("plan", name) for name in ("seed", "runs", "trials")},
}
"""Every kind of number that a file has, and where."""

WRONG_FORM = {
    "NaN": lambda d: changed(d, R, "means", "returns", 0, to=float("nan")),
    "infinite": lambda d: changed(d, R, "exact", "returns", 1, to=float("-inf")),
    "too large for a float": lambda d: changed(d, R, "optimum", to=10**400),
    "negative variance": lambda d: changed(d, R, "variances", "asks", 0, to=-1.0),
    "negative asks": lambda d: changed(d, R, "asked", 0, 3, to=-1.0),
    "more arrive than all": lambda d: changed(d, R, "exact", "arrived", 0, to=1.5),
    "fewer arrive than none": lambda d: changed(d, R, "not_arrived", 0, to=4),
    "half a trial": lambda d: changed(d, R, "not_arrived", 0, to=0.5),
    "text for a number": lambda d: changed(d, R, "means", "returns", 0, to="12"),
    "truth for a number": lambda d: changed(d, R, "optimum", to=True),
    "number for a truth": lambda d: changed(d, R, "optimum_exact", to=1),
    "number for a list": lambda d: changed(d, R, "visited", to=3.0),
    "number for an object": lambda d: changed(d, R, "means", to=3.0),
    "null for an object": lambda d: changed(d, R, "variances", to=None),
    "null for a number": lambda d: changed(d, R, "means", "asks", 0, to=None),
    "three values for two runs": lambda d: more(d, R, "means", "returns"),
    "three exact values": lambda d: more(d, R, "exact", "arrived"),
    "three visited": lambda d: more(d, R, "visited"),
    "three robots": lambda d: more(d, R, "stays"),
    "three robots' means": lambda d: more(d, R, "robot_means", "asks"),
    "one more cell": lambda d: more(d, R, "asked", 0),
    "one run": lambda d: less(d, R, "not_arrived", 0),
    "one robot": lambda d: less(d, R, "asked", 0),
    "no means": lambda d: less(d, R, "means"),
    "no mean return": lambda d: less(d, R, "means", "returns"),
    "no exact arrivals": lambda d: less(d, R, "exact", "arrived"),
    "no reference": lambda d: less(d, R, "reference"),
    "no condition": lambda d: less(d, "condition"),
    "no computation": lambda d: less(d, "computation"),
    "no plan": lambda d: less(d, "plan"),
    "no seed": lambda d: less(d, "plan", "seed"),
    "no scenario": lambda d: less(d, "scenario"),
    "no result": lambda d: less(d, R),
    "unknown measure": lambda d: more(d, R, "means"),
    "unknown field": lambda d: more(d, R),
    "unknown head": lambda d: more(d),
    "other condition": lambda d: changed(d, "condition", to=NONCOOP),
    "other seed": lambda d: changed(d, "plan", "seed", to=6),
    "seed below 0": lambda d: changed(d, "plan", "seed", to=-1),
    "own scenario": lambda d: changed(d, "scenario", to={"map": "env1"}),
}
"""Data that no result has, whether its digest is recomputed or not."""

AS_TEXT = {
    "truncated": lambda text: text[:-40],
    "one byte lost": lambda text: text.replace("5", "", 1),
    "empty": lambda text: "",
    "a list": lambda text: "[]",
    "nested deeply": lambda text: "[" * 100_000,
    "no UTF-8": lambda text: "\udcff" + text,
    "a key twice": lambda text: text.replace('"seed"', '"seed": 5, "seed"', 1),
    "no format": lambda text: text.replace('"format": 5, ', ""),
    "no digest": lambda text: text.replace('"digest"', '"fun"'),
    "other digest": lambda text: text.replace('"digest": "', '"digest": "0', 1),
    "learner renamed": lambda text: text.replace("coop", "noncoop"),
}


def edited(path, change):
    """Change the data of a file, and not its digest."""
    path.write_text(json.dumps(change(json.loads(path.read_text()))))


def signed(path, change):
    """Change the data of a file, and its digest too, as a forger does: even NaN."""
    content = change(json.loads(path.read_text()))
    del content["digest"], content["format"]
    try:
        path.write_text(to_text(content))
    except ValueError:
        path.write_text(json.dumps({"format": 5, **content}))


def is_refused(folder, capsys, name):
    """Check that nobody who reads shows it; return the one line."""
    with pytest.raises(ResultsError) as caught:
        read_results(folder)
    line = str(caught.value)
    assert name in line and "\n" not in line
    out = folder.parent / "x.png"
    assert main(["plot", str(folder), "--out", str(out)]) == 2
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", f"error: {line}\n")
    assert [path.name for path in folder.parent.iterdir()] == [folder.name]
    return line


def is_computed_again(folder, original, condition=COOP):
    """Check that who writes puts the file aside, says so once, and computes the same again."""
    path = file_of(folder, condition)
    lines = []
    damaged = path.read_bytes()
    found = run_experiment(
        [condition], out=folder, seed=PLAN.seed, **FEW, say=lines.append
    )
    aside = path.with_name(path.name + ".broken")
    assert aside.read_bytes() == damaged
    [line] = lines
    assert line.startswith(f"{path}: ")
    assert line.endswith(f"; it is now {aside.name}, and is computed again")
    assert path.read_bytes() == file_of(original, condition).read_bytes()
    assert list(found) == [condition]
    assert len(read_results(folder)[1]) == 2


@pytest.mark.parametrize("place", NUMBERS.values(), ids=NUMBERS)
def test_a_changed_number_is_not_shown(folder, originals, capsys, place):
    def next_float(data):
        spot = data
        for key in place:
            spot = spot[key]
        whole = isinstance(spot, int)
        return changed(
            data, *place, to=spot + 1 if whole else float(np.nextafter(spot, 1e9))
        )

    edited(file_of(folder), next_float)
    assert "does not fit its digest" in is_refused(folder, capsys, f"{COOP}.json")
    is_computed_again(folder, originals["as they are"])


@pytest.mark.parametrize("write", [edited, signed])
@pytest.mark.parametrize("change", WRONG_FORM.values(), ids=WRONG_FORM)
def test_what_has_not_the_form_is_not_shown(folder, originals, capsys, change, write):
    write(file_of(folder), change)
    is_refused(folder, capsys, f"{COOP}.json")
    is_computed_again(folder, originals["as they are"])


REFERENCES = {
    "optimum": lambda d: changed(d, R, "optimum", to=130.0),
    "optimum_exact": lambda d: changed(d, R, "optimum_exact", to=False),
    "returns of shortest paths": lambda d: changed(
        d, R, "reference", "returns", to=90.0
    ),
}


@pytest.mark.parametrize("what", REFERENCES)
def test_references_are_computed_again_and_compared(folder, originals, capsys, what):
    """A forger who computes the digest again cannot change what the scenario itself says."""
    signed(file_of(folder), REFERENCES[what])
    assert f"its {what} is " in is_refused(folder, capsys, f"{COOP}.json")
    is_computed_again(folder, originals["as they are"])


@pytest.mark.parametrize("change", AS_TEXT.values(), ids=AS_TEXT)
def test_damaged_text_is_not_shown(folder, originals, capsys, change):
    path = file_of(folder)
    path.write_bytes(change(path.read_text()).encode("utf-8", "surrogateescape"))
    is_refused(folder, capsys, f"{COOP}.json")
    is_computed_again(folder, originals["as they are"])


@pytest.mark.parametrize(
    ("whose", "condition", "words"),
    [
        ("as they are", NONCOOP, f"it holds the result of '{NONCOOP}'"),
        ("other seeds", COOP, "computed with seed 17, this directory has seed 5"),
        ("more runs", COOP, "computed with runs 3, this directory has runs 2"),
        ("more trials", COOP, "computed with trials 4, this directory has trials 3"),
    ],
)
def test_a_file_from_elsewhere_is_not_shown(
    folder, originals, capsys, whose, condition, words
):
    shutil.copy(file_of(originals[whose], condition), file_of(folder))
    assert words in is_refused(folder, capsys, f"{COOP}.json")
    is_computed_again(folder, originals["as they are"])


def test_files_that_changed_places_are_both_computed_again(folder, originals):
    one = file_of(folder)
    other = file_of(folder, NONCOOP)
    texts = one.read_text(), other.read_text()
    one.write_text(texts[1])
    other.write_text(texts[0])
    with pytest.raises(ResultsError, match="holds the result of"):
        read_results(folder)
    with pytest.warns(UserWarning, match="is computed again") as warned:
        run_experiment([COOP, NONCOOP], out=folder, seed=PLAN.seed, **FEW)
    assert len(warned) == 2
    assert (one.read_text(), other.read_text()) == texts


@pytest.mark.parametrize("number", [0, 1, 2, 3, 4])
def test_another_format_is_refused_by_all(folder, capsys, number):
    path = file_of(folder)
    path.write_text(path.read_text().replace('"format": 5', f'"format": {number}'))
    before = path.read_bytes()
    line = is_refused(folder, capsys, f"{COOP}.json")
    assert f"is in format {number}, this version reads format 5; " in line
    with pytest.raises(ResultsError, match=f"is in format {number}"):
        run_experiment([COOP], out=folder, seed=PLAN.seed, **FEW)
    assert path.read_bytes() == before


def test_what_is_put_aside_is_never_overwritten(folder):
    path = file_of(folder)
    for number in range(3):
        path.write_text(str(number))
        run_experiment([COOP], out=folder, seed=PLAN.seed, **FEW, say=lambda line: None)
    aside = sorted(path.parent.glob("*.broken*"))
    assert [one.read_text() for one in aside] == ["0", "1", "2"]


def test_the_layout_of_the_text_does_not_matter(folder):
    """The digest is of the content: a tool that writes keys and blanks otherwise does no harm."""
    before = read_results(folder)
    path = file_of(folder)
    path.write_text(json.dumps(json.loads(path.read_text()), indent=3, sort_keys=True))
    assert read_results(folder) == before


def test_every_float_reads_back_with_its_digest():
    draw = np.random.default_rng(1)
    bits = draw.integers(0, 2**64, 2000, dtype=np.uint64).view(np.float64)
    values = [
        *bits[np.isfinite(bits)].tolist(),
        -0.0,
        5e-324,
        sys.float_info.max,
        0.1 + 0.2,
        1e22,
    ]
    data = {"values": values, "whole": [2**63 - 1, 0, -1], "text": "\u00e9\ud83d\ude00"}
    content = json.loads(to_text(data))
    assert content.pop("digest") == digest_of(content)
    assert list(map(repr, content["values"])) == list(map(repr, values))
    with pytest.raises(ValueError, match="not JSON compliant"):
        to_text({"values": [float("nan")]})


MANIFESTS = {
    "seed": lambda d: changed(d, "seed", to=6),
    "runs": lambda d: changed(d, "runs", to=3),
    "trials": lambda d: changed(d, "trials", to=4),
    "version": lambda d: changed(d, "version", to="99"),
    "text for a number": lambda d: changed(d, "seed", to="5"),
    "half a run": lambda d: changed(d, "runs", to=2.5),
    "no run": lambda d: changed(d, "runs", to=0),
    "NaN": lambda d: changed(d, "trials", to=float("nan")),
    "no trials": lambda d: less(d, "trials"),
    "unknown field": lambda d: more(d),
}


@pytest.mark.parametrize("write", [edited, signed])
@pytest.mark.parametrize("change", MANIFESTS.values(), ids=MANIFESTS)
def test_a_changed_manifest_is_refused_by_all(folder, capsys, change, write):
    path = folder / "results.json"
    write(path, change)
    before = path.read_bytes()
    if write is signed and change in [
        MANIFESTS[name] for name in ("seed", "runs", "trials")
    ]:
        with pytest.raises(ResultsError, match="computed with (seed|runs|trials)"):
            read_results(folder)  # its files are of another plan
    elif write is signed and change is MANIFESTS["version"]:
        read_results(folder)  # nothing depends on it
        return
    else:
        is_refused(
            folder, capsys, "results.json: is no results.json of this software: "
        )
    with pytest.raises(ResultsError, match="results"):
        run_experiment([COOP], out=folder, seed=PLAN.seed, **FEW)
    assert path.read_bytes() == before


def test_the_command_line_says_one_line_and_goes_on(folder, capsys, originals):
    file_of(folder).write_text("{")
    words = [
        "reproduce",
        COOP,
        "--out",
        folder,
        "--seed",
        PLAN.seed,
        "--engine",
        "python",
    ]
    words += ["--runs", PLAN.runs, "--trials", PLAN.trials, "--jobs", 1]
    assert main([str(word) for word in words]) == 0
    said = capsys.readouterr()
    [line] = [line for line in said.err.splitlines() if "computed again" in line]
    assert f"{COOP}.json: it is not readable as JSON" in line
    assert (
        file_of(folder).read_bytes() == file_of(originals["as they are"]).read_bytes()
    )


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
    over = {"penalty": [-5, -50], "learner": ["coop", "factored"]}
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
    condition, _ = parse_id(COOP)
    content = json.loads(file_of(folder).read_text())
    assert list(content)[:2] == ["digest", "format"]
    assert (content["format"], content["condition"], content["scenario"]) == (
        5,
        COOP,
        None,
    )
    assert content["plan"] == {"seed": 5, "runs": 2, "trials": 3}
    assert content["computation"] == computation_digest(condition)
    with open_results(folder, PLAN) as results:
        assert results.load(condition).means == content["result"]["means"]
