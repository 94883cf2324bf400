# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `reproduce` writes: tables and figures, from made-up results of real cells."""

import csv
import io
import math

import pytest
from made_up_results import PLAN, made_up, result_of

from sparse_coord_ros.core.game.scenario import SETTINGS
from sparse_coord_ros.core.runs.measures import MEASURES
from sparse_coord_ros.studies.catalogue import NAMES, experiment
from sparse_coord_ros.studies.compared import paper
from sparse_coord_ros.studies.report import to_csv, to_markdown, write_report


def results_of(name, changes=()):
    """Return made-up results of an experiment; `changes` of results by id."""
    changes = dict(changes)
    return [
        made_up(one, **changes.get(one.id, {})) for one in experiment(name).conditions
    ]


def rows_of_csv(results):
    return list(csv.DictReader(io.StringIO(to_csv(results))))


def table_of(text):
    """Return the rows of a Markdown table, each by the names of its columns."""
    lines = [
        [cell.strip() for cell in line.strip("|\n ").split("|")]
        for line in text.strip().split("\n")
    ]
    columns, _, *rows = lines
    assert {len(row) for row in rows} == {len(columns)}
    return [dict(zip(columns, row, strict=True)) for row in rows]


def test_csv_has_one_value_a_field_in_full_precision():
    table1 = rows_of_csv(results_of("table1"))
    assert [r["condition"] for r in table1] == [
        one.id for one in experiment("table1").conditions
    ]
    result = made_up(experiment("table1").conditions[2])
    coop = table1[2]
    measures = result.measures
    assert float(coop["returns"]) == measures.mean("returns")
    assert float(coop["asks_error"]) == measures.error("asks")
    assert coop["source"] == "trials"
    assert float(coop["paper_returns"]) == 126.3
    assert float(coop["dense_bytes"]) == 21 * 21 * 32
    assert coop["optimum_exact"] == "True"
    by_robot = [float(coop[f"returns_robot_{k}"]) for k in (1, 2)]
    assert by_robot == measures.by_robot()["returns"]
    assert coop["returns_robot_3"] == ""  # of env2-4r
    for r in table1:
        assert not [value for value in r.values() if " " in value]
        assert set(SETTINGS) <= set(r)


def test_the_paper_stands_beside_its_own_settings_only():
    assert paper(result_of("env1"), "returns") == (126.3, 10.1)
    other = result_of("env1", settings={"penalty": -20, "ask_cost": 2})
    assert paper(other, "returns") is None
    assert paper(result_of("env1", settings={"penalty": -10}), "returns") is None


def test_numbers_of_a_table_are_those_of_the_runs():
    returns = [119.0, 121.0, 119.0, 121.0]
    results = results_of("table1", {"env1/indiv/penalty=-20": {"returns": returns}})
    rows = table_of(to_markdown("table1", results))
    assert [row["scenario"] for row in rows] == ["env1", "env2-2r", "env2-4r"]
    assert rows[0]["indiv"] == f"120.00 ± {math.sqrt(4 / 3) / 2:.2f}"
    assert (rows[0]["indiv, paper"], rows[0]["shortest paths"]) == ("119.50", "119.68")
    assert rows[0]["best asking team found"] == "121.20"
    assert rows[0]["joint optimum"] == "121.89"
    assert rows[2]["best asking team found"] == "-"
    assert rows[2]["joint optimum"] == "<= 111.32"


def test_table_2_has_its_two_measures():
    rows = table_of(to_markdown("table2", results_of("table2")))
    assert [row["measure"] for row in rows[::3]] == ["time_to_goal", "miscoordinations"]
    assert rows[0]["coop, paper"] == "9.94"


def test_a_table_of_one_learner_has_the_yardsticks_too():
    result = made_up(experiment("table1").conditions[0])
    [row] = table_of(to_markdown("table1", [result]))
    assert row["joint optimum"] == "121.89"


@pytest.mark.parametrize("name", [name for name in NAMES if "table" not in name])
def test_any_other_table_has_a_row_for_each_condition(name):
    results = [made_up(one) for one in experiment(name).conditions[:16]]
    rows = table_of(to_markdown(name, results))
    assert len(rows) == len(results)
    for row, result in zip(rows, results, strict=True):
        assert row["scenario"] == result.scenario.name
        assert {key: row[key] for key, _ in result.condition.settings} == dict(
            result.condition.settings
        )


def test_a_single_run_has_no_error():
    single = dict.fromkeys(MEASURES, [100.0])
    results = [made_up(each, **single) for each in experiment("table1").conditions]
    text = to_markdown("table1", results)
    assert "100.00 ± -" in text and "nan" not in text


def test_what_is_written(tmp_path):
    """The same results give the same bytes."""
    one = experiment("penalty100")
    found = {result.id: result for result in results_of("penalty100")}
    for folder in ("a", "b"):
        write_report(tmp_path / folder, [one], found)
    files = {path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*.*")}
    assert set(map(str, files)) == {
        "figures/penalty100.png",
        "tables/penalty100.csv",
        "tables/penalty100.md",
    }
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (
            tmp_path / "b" / file
        ).read_bytes()
    png = (tmp_path / "a/figures/penalty100.png").read_bytes()
    assert png.startswith(b"\x89PNG\r\n\x1a\n") and b"Software" not in png
    assert PLAN.runs == next(iter(found.values())).runs
