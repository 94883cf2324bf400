# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The files of experiments: tables as CSV and as Markdown, and figures as PNG.

It needs pandas and Matplotlib: import it late.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from sparse_coord_ros.base.files import write_whole
from sparse_coord_ros.core.game.settings import as_text
from sparse_coord_ros.core.runs.measures import HEADINGS
from sparse_coord_ros.core.solve.shipped import shipped_best_team
from sparse_coord_ros.show.charts import rendered
from sparse_coord_ros.studies.catalogue import Experiment
from sparse_coord_ros.studies.compared import (
    best_asking_team,
    by_scenario,
    paper,
)
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.experiment_figures import figures_of
from sparse_coord_ros.studies.frames import to_pandas

BESIDE_PAPER: Mapping[str, Sequence[str]] = {
    "table1": ["returns"],
    "table2": ["time_to_goal", "miscoordinations"],
    "table3": ["returns"],
}
"""The measures of the paper's tables: ours stand beside the paper's numbers."""

Row = dict[str, str]


def write_report(
    directory: Path,
    chosen: Sequence[Experiment],
    results_by_id: Mapping[str, ConditionResult],
) -> None:
    """Write tables and figures; the same results give the same bytes.

    Args:
        directory: gets the folders `tables` (NAME.csv and NAME.md of each experiment) and
            `figures` (PNG).
        chosen: the experiments.
        results_by_id: result of every condition of these experiments, by its id.
    """
    (directory / "tables").mkdir(parents=True, exist_ok=True)
    (directory / "figures").mkdir(exist_ok=True)
    for experiment in chosen:
        results = [results_by_id[condition.id] for condition in experiment.conditions]
        write_whole(directory / f"tables/{experiment.name}.csv", to_csv(results))
        write_whole(
            directory / f"tables/{experiment.name}.md",
            to_markdown(experiment.name, results),
        )
        for name, draw in figures_of(experiment.name).items():
            picture = rendered(draw(results), "png", few=True)
            write_whole(directory / f"figures/{name}.png", picture)


def to_markdown(name: str, results: Sequence[ConditionResult]) -> str:
    """Return the table of an experiment: means ± their standard errors."""
    measures = BESIDE_PAPER.get(name)
    rows = _each(results) if measures is None else _beside_paper(results, measures)
    table = list(rows)
    columns = list(dict.fromkeys(column for row in table for column in row))
    lines = [columns, [":--"] + ["--:"] * (len(columns) - 1)]
    lines += [[row.get(column, "-") for column in columns] for row in table]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _beside_paper(
    results: Sequence[ConditionResult], measures: Sequence[str]
) -> Iterator[Row]:
    """Yield a row for each measure and scenario, with a column for each learner."""
    for measure in measures:
        for group in by_scenario(results):
            row = {"scenario": group[0].scenario.name, "measure": measure}
            for result in group:
                title = result.learner.label
                row[title] = _cells(result)[HEADINGS[measure]]
                printed = paper(result, measure)
                if printed is not None:
                    row[f"{title}, paper"] = f"{printed[0]:.2f}"
            row["shortest paths"] = group[0].shortest_paths.in_words(measure)
            if measure == "returns":
                row |= _yardsticks(group[0])
            yield row


def _each(results: Sequence[ConditionResult]) -> Iterator[Row]:
    """Yield a row for each condition, with the settings that it changes."""
    names = dict.fromkeys(
        name for result in results for name, _ in result.condition.settings
    )
    for result in results:
        plain = result.scenario.plain_settings
        yield {
            "scenario": result.scenario.name,
            "learner": result.learner.label,
            **{name: as_text(plain[name]) for name in names},
            **_cells(result),
            "failed teams": f"{result.measures.failed} of {result.runs}",
            "shortest paths": result.shortest_paths.in_words("returns"),
            **_yardsticks(result),
        }


def _cells(result: ConditionResult) -> Row:
    """Return the cells of a result's measures."""
    return result.measures.cells(optimum=result.optimum)


def _yardsticks(result: ConditionResult) -> Row:
    """Return the best known team, and the joint optimum; `<=` marks an upper bound."""
    best = best_asking_team(result)
    team = shipped_best_team(result.scenario)
    row = {}
    if team is not None:
        row["best asking team found"] = f">= {team.value:.2f}"
    elif best is not None:
        row["best asking team found"] = f"{best:.2f}"
    exact = "" if result.optimum_exact else "<= "
    row["joint optimum"] = f"{exact}{result.optimum:.2f}"
    return row


def to_csv(results: Iterable[ConditionResult]) -> str:
    """Return a CSV file: one row a condition, one value a field, in full precision."""
    return to_pandas(results).to_csv(index=False, lineterminator="\n")
