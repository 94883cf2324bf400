# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`reproduction.md`, and the files of tables and figures beside it."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from sparse_coord_ros import __version__
from sparse_coord_ros.engine.experiments import NAMES, Experiment
from sparse_coord_ros.engine.report.crowd import crowd_section
from sparse_coord_ros.engine.report.entries import Entries, entries_of
from sparse_coord_ros.engine.report.figures import save
from sparse_coord_ros.engine.report.paper_tables import (
    as_good_as_baselines,
    reward_section,
    table2_section,
)
from sparse_coord_ros.engine.report.penalties import figure4_section, penalty100_section
from sparse_coord_ros.engine.report.places import where_section
from sparse_coord_ros.engine.report.section import Section
from sparse_coord_ros.engine.report.sweeps import (
    ask_cost_section,
    perception_section,
    uneven_section,
)
from sparse_coord_ros.engine.report.tables import to_csv
from sparse_coord_ros.engine.results import ConditionResult, Plan, write_result

SECTIONS: Mapping[str, Callable[[str, Entries], Section]] = {
    "table1": reward_section,
    "table2": table2_section,
    "table3": reward_section,
    "figure4": figure4_section,
    "penalty100": penalty100_section,
    "ask_cost": ask_cost_section,
    "perception": perception_section,
    "uneven": uneven_section,
    "crowd": crowd_section,
    "where": where_section,
}
"""What shows each experiment."""

MISSES = "Rows of the paper that are not reproduced, or are inconsistent"


def write_document(
    directory: Path,
    plan: Plan,
    chosen: Sequence[Experiment],
    found: Mapping[str, ConditionResult],
) -> None:
    """Write tables, figures and the document; see `sparse_coord_ros.engine.report`."""
    tables, figures = directory / "tables", directory / "figures"
    for folder in (tables, figures):
        folder.mkdir(parents=True, exist_ok=True)
    sections, tabled = {}, {}
    for experiment in chosen:
        entries = entries_of(experiment, found)
        section = SECTIONS[experiment.name](experiment.name, entries)
        sections[experiment.name] = section
        tabled[experiment.name] = entries
        body = "\n".join(table.to_markdown() for table in section.tables)
        write_result(tables / f"{experiment.name}.md", f"# {experiment.title}\n\n{body}")
        write_result(tables / f"{experiment.name}.csv", to_csv(entries))
        for picture in section.pictures:
            save(picture.figure, figures / picture.name)
    write_result(directory / "reproduction.md", _document(plan, chosen, sections, tabled))


def _document(
    plan: Plan,
    chosen: Sequence[Experiment],
    sections: Mapping[str, Section],
    tabled: Mapping[str, Entries],
) -> str:
    findings = [text for section in sections.values() for text in section.findings]
    if {"table1", "table3"} <= tabled.keys():
        both = Entries([*tabled["table1"], *tabled["table3"]])
        findings.insert(0, as_good_as_baselines("Tables 1 and 3", both))
    misses = [text for section in sections.values() for text in section.misses]
    parts = [_opening(plan, chosen), _list("Findings", findings)]
    if misses:
        parts.append(_list(MISSES, misses))
    parts += [_experiment(one, sections[one.name]) for one in chosen]
    return "\n".join(parts)


def _list(title: str, lines: Sequence[str]) -> str:
    return "\n".join([f"## {title}\n", *(f"- {line}" for line in lines), ""])


def _opening(plan: Plan, chosen: Sequence[Experiment]) -> str:
    names = [experiment.name for experiment in chosen]
    whole = tuple(names) == NAMES
    command = f"sparse_coord reproduce {'' if whole else ' '.join(names) + ' '}--runs {plan.runs} "
    command += f"--trials {plan.trials} --seed {plan.seed} --out results"
    make = "`make reproduce` runs all experiments with the default numbers. " if whole else ""
    return f"""# Reproduction

What the learners of Melo & Veloso, "Learning of Coordination: Exploiting Sparse Interactions in
Multiagent Systems" (AAMAS 2009), are worth in this implementation, beside the paper's numbers and
beside exact values. Every number on this page is computed from the results (version
{__version__}, {plan.runs} learning runs of {plan.trials} trials for every cell, seeds {plan.seed}
to {plan.seeds[-1]}).

{make}To compute them again:

```
{command}
```

How to read the tables:

- Indiv.: Q-learning of one robot at a time; Non-coop.: Q-learning of all robots at once; Coop.:
  Algorithm 1 of the paper.
- `mean ± spread`: the spread is the standard deviation over single robots, trials and runs, as
  the paper prints it.
- s.e.: the standard error of the mean; the learning runs are the independent samples. The paper's
  standard errors are taken from its spreads and its number of trials.
- Run i has the same seed in every cell: common random numbers, the robots' moves in the trials
  among them. Differences between our cells, and shares of a gap, are therefore computed run by
  run, and their standard errors are those of paired samples. They are smaller than the standard
  errors of the two means suggest where the two learned teams walk alike.
- Joint optimum: the best policy of one controller that sees all robots and never pays for asking.
  `<=` marks an upper bound, where the joint state space is too large for the optimum itself.
- Total discounted reward includes the goal's payments carried on for ever, the penalties, and the
  cost of each COORDINATE.
- The files in `tables` hold the same in full precision, one row a cell.
"""


def _experiment(experiment: Experiment, section: Section) -> str:
    parts = [f"## {experiment.title}\n", f"{section.shown}\n"]
    parts += [table.to_markdown() for table in section.tables]
    for picture in section.pictures:
        parts.append(f"![{picture.name}](figures/{picture.name}.png)\n\n*{picture.caption}*\n")
    parts += [f"{text}\n" for text in section.text]
    if section.misses:
        parts.append("Rows of the paper that do not fit are listed at the top of this page.\n")
    return "\n".join(parts)
