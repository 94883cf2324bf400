# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`reproduction.md`, and the files of tables and figures beside it."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from sparse_coord_ros.experiments.catalogue import NAMES, Experiment
from sparse_coord_ros.experiments.report import paper, sweeps
from sparse_coord_ros.experiments.report.analysis import AGREE, NEAR
from sparse_coord_ros.experiments.report.charts import save
from sparse_coord_ros.experiments.report.entries import Entry, entries_of, to_csv
from sparse_coord_ros.experiments.report.section import Section
from sparse_coord_ros.experiments.report.text import TEXTS, Row, percent, shared, to_markdown
from sparse_coord_ros.experiments.store import ConditionResult, Plan, write_result
from sparse_coord_ros.version import __version__

SECTIONS: Mapping[str, Callable[[Sequence[Entry]], Section]] = {
    "table1": paper.reward_section,
    "table2": paper.table2_section,
    "table3": paper.reward_section,
    "figure4": sweeps.figure4_section,
    "penalty100": sweeps.penalty100_section,
    "ask_cost": sweeps.ask_cost_section,
    "perception": sweeps.perception_section,
    "uneven": sweeps.uneven_section,
    "crowd": sweeps.crowd_section,
    "where": sweeps.where_section,
}
"""What shows each experiment; others have the default section."""

VALUES = {
    **{name: TEXTS[name] for name in ("points", "spreads")},
    **{"AGREE": AGREE, "NEAR": NEAR, "MARGIN": paper.MARGIN, "ARRIVE": percent(paper.ARRIVE)},
}
"""What every text may use."""


def write_report(
    directory: Path,
    plan: Plan,
    chosen: Sequence[Experiment],
    found: Mapping[str, ConditionResult],
) -> None:
    """Write tables, figures and `reproduction.md`; the same results give the same bytes.

    Args:
        directory: gets `reproduction.md` and the folders `tables` (NAME.md and NAME.csv of each
            experiment) and `figures` (PNG and SVG).
        plan: seed, runs and trials of every condition.
        chosen: the experiments, in the order in which they are to appear.
        found: result of every condition of these experiments, by its id.
    """
    (directory / "figures").mkdir(parents=True, exist_ok=True)
    claims: list[Row] = []
    misses: list[Row] = []
    parts = []
    rewards = {one.name: entries_of(one, found) for one in chosen if one.name in paper.REWARDS}
    tables = [entry for entries in rewards.values() for entry in entries]
    for one in chosen:
        entries = entries_of(one, found)
        section = SECTIONS.get(one.name, sweeps.default_section)(entries)
        title = one.title.split(":")[0]
        values = {**VALUES, **shared(entries), "title": title, **section.values}
        texts = TEXTS.get(one.name, TEXTS["default"])
        parts.append(f"## {one.title}\n\n{texts['shown']}\n")
        body = [
            f"{caption.format(**values)}\n\n{to_markdown(rows)}"
            for caption, rows in zip(texts["tables"], section.tables, strict=True)
        ]
        write_result(directory / f"tables/{one.name}.md", "\n".join([f"# {one.title}\n", *body]))
        write_result(directory / f"tables/{one.name}.csv", to_csv(entries))
        parts += body
        stems = [one.name, f"{one.name}_variance"]
        for name, caption, figure in zip(stems, texts["figures"], section.figures, strict=False):
            save(figure, directory / f"figures/{name}")
            parts.append(f"![{name}](figures/{name}.png)\n\n*{caption.format(**values)}*\n")
        parts += [f"{text}\n" for note in texts["notes"] if (text := note.format(**values))]
        claims += _claims(texts, values, section.agrees)
        if one.name == next(iter(rewards), None):
            numbers = " and ".join(name[-1] for name in rewards)
            compared, agrees = paper.compared(tables)
            values = {**VALUES, **compared, "title": f"Table{'s' * (len(rewards) - 1)} {numbers}"}
            claims += _claims(TEXTS["rewards"], values, agrees)
        misses += section.misses
    if misses:
        rows, maps = to_markdown(misses), paper.provenances(tables, misses)
        parts.append(TEXTS["rewards"]["misses"].format(rows=rows, maps=maps))
    names = [one.name for one in chosen]
    whole = tuple(names) == NAMES
    make = "`make reproduce` runs all experiments with the default numbers. " if whole else ""
    alone = "" if plan.runs > 1 else " A single run has no standard error: nothing is judged."
    if alone:
        claims = [{**row, "agrees": None} for row in claims]
    opening = TEXTS["opening"].format(
        **VALUES,
        version=__version__,
        runs=plan.runs,
        trials=plan.trials,
        seed=plan.seed,
        last=plan.seeds[-1],
        make=make,
        names="" if whole else " ".join([*names, ""]),
        alone=alone,
        findings=to_markdown(claims),
    )
    write_result(directory / "reproduction.md", "\n".join([opening, *parts]))


def _claims(
    texts: Mapping[str, Any], values: Mapping[str, object], agrees: Sequence[tuple[int, int]]
) -> Iterator[Row]:
    """Yield rows of the table of findings."""
    for (source, text, measured), (holds, cases) in zip(texts["claims"], agrees, strict=True):
        yield {
            "claim": text.format(**values),
            "from": source.format(**values),
            "measured here": measured.format(**values),
            "agrees": {0: "no", cases: "yes"}.get(holds, f"in {holds} of {cases}"),
        }
