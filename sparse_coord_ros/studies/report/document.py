# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What there is to say of experiments, and `reproduction.md` with its tables and figures."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
from matplotlib.figure import Figure

from sparse_coord_ros.base.version import __version__
from sparse_coord_ros.core.solve.verdict import RARE
from sparse_coord_ros.studies.catalogue import NAMES, Experiment
from sparse_coord_ros.studies.report import analysis, text
from sparse_coord_ros.studies.report.charts import save
from sparse_coord_ros.studies.report.drawings import figures_of
from sparse_coord_ros.studies.report.reasons import misses, provenances
from sparse_coord_ros.studies.report.rows import to_csv
from sparse_coord_ros.studies.report.sections import (
    SECTIONS,
    JudgedClaim,
    reward_claims,
)
from sparse_coord_ros.studies.report.text import Row
from sparse_coord_ros.studies.store import ConditionResult, Plan, write_result

REWARDS = ("table1", "table3")
"""The experiments on rewards that the paper has numbers of."""

BLOCKS = {"shown": "shown.md.j2", "notes": "notes.md.j2"}
"""A layout that shows nothing but this block of an experiment's template."""


@dataclass(frozen=True)
class Part:
    """What there is to say of one experiment.

    Attributes:
        name: what `reproduce` calls it.
        title: what it shows.
        results: the result of each of its conditions.
        rows: its table.
        values: what else its template names.
    """

    name: str
    title: str
    results: Sequence[ConditionResult]
    rows: Sequence[Row]
    values: Mapping[str, Any]

    def figures(self) -> dict[str, Figure]:
        """Draw its figures; return them by the names of their files."""
        return figures_of(self.name, self.results)

    def markdown(self, figures: Sequence[str]) -> str:
        """Return its section of the document, with the figures of these names."""
        return self._rendered("part.md.j2", figures=figures)

    def paragraphs(self, block: str) -> list[str]:
        """Return its words as plain text: the block "shown" before the table, or "notes" after."""
        found = self._rendered(BLOCKS[block]).split("\n\n")
        return [" ".join(one.split()) for one in found if one.strip()]

    def _rendered(self, layout: str, **more: Any) -> str:
        page = _pages().get_template(f"{self.name}.md.j2")
        said = {
            "name": self.name,
            "title": self.title,
            "rows": self.rows,
            **self.values,
        }
        return page.render(layout=layout, **said, **more)


@dataclass(frozen=True)
class Findings:
    """What there is to say of experiments.

    Attributes:
        plan: seed, runs and trials of every condition.
        parts: the experiments.
        claims: the table of findings.
        missed: the paper's rows that are not reproduced, or cannot be, each with the reason.
        maps: where the maps come from on which those rows are.
    """

    plan: Plan
    parts: Sequence[Part]
    claims: Sequence[Row]
    missed: Sequence[Row]
    maps: Sequence[str]


def findings(
    plan: Plan, chosen: Sequence[Experiment], found: Mapping[str, ConditionResult]
) -> Findings:
    """Return what there is to say of experiments; arguments as of `write_report`."""
    results = {one.name: [found[each.id] for each in one.conditions] for one in chosen}
    rewards = [name for name in REWARDS if name in results]
    shown = [one for name in rewards for one in results[name]]
    source = (
        f"Table{'s' * (len(rewards) - 1)} {' and '.join(name[-1] for name in rewards)}"
    )
    elsewhere = {
        name: own for name, own in results.items() if name not in (*REWARDS, "table2")
    }
    claims = reward_claims(source, shown, elsewhere) if shown else []
    parts = []
    for one in chosen:
        own = results[one.name]
        section = SECTIONS[one.name](own)
        claims += section.claims
        values = {"game": _game(own[0]), "NEAR": analysis.NEAR, "RARE": RARE}
        parts.append(
            Part(one.name, one.title, own, section.rows, {**values, **section.values})
        )
    missed = misses(shown)
    judged = list(_judged(claims, judged=plan.runs > 1))
    return Findings(plan, parts, judged, missed, provenances(shown, missed))


def write_report(
    directory: Path,
    plan: Plan,
    chosen: Sequence[Experiment],
    found: Mapping[str, ConditionResult],
) -> None:
    """Write tables, figures and `reproduction.md`; the same results give the same bytes.

    Args:
        directory: gets `reproduction.md` and the folders `tables` (NAME.csv of each experiment)
            and `figures` (PNG and SVG).
        plan: seed, runs and trials of every condition.
        chosen: the experiments, in the order in which they are to appear.
        found: result of every condition of these experiments, by its id.
    """
    (directory / "figures").mkdir(parents=True, exist_ok=True)
    said = findings(plan, chosen, found)
    parts = []
    for part in said.parts:
        write_result(directory / f"tables/{part.name}.csv", to_csv(part.results))
        figures = part.figures()
        for name, figure in figures.items():
            save(figure, directory / f"figures/{name}")
        parts.append(part.markdown(list(figures)))
    chosen_names = [part.name for part in said.parts]
    whole = tuple(chosen_names) == NAMES
    whole_page = _pages().get_template("reproduction.md.j2")
    whole_text = whole_page.render(
        version=__version__,
        plan=plan,
        whole=whole,
        names="" if whole else " ".join([*chosen_names, ""]),
        AGREE=f"{analysis.AGREE:g}",
        claims=said.claims,
        parts=parts,
        misses=said.missed,
        maps=said.maps,
        linked=True,
    )
    write_result(directory / "reproduction.md", whole_text)


def how_to_read() -> list[str]:
    """Return how to read the tables, as plain text: a list of points."""
    points = "\n" + _pages().get_template("reading.md.j2").render(linked=False)
    return [
        " ".join(point.replace("`", "").split()) for point in points.split("\n- ")[1:]
    ]


def templates(folder: Path) -> jinja2.Environment:
    """Return the templates of a folder, with the filters that write tables and numbers."""
    found = jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # noqa: S701 - the pages are Markdown
    )
    found.filters |= {
        "table": text.to_markdown,
        "listed": text.listed,
        "named": text.named,
    }
    return found


@cache
def _pages() -> jinja2.Environment:
    return templates(Path(__file__).with_name("templates"))


def _game(result: ConditionResult) -> str:
    scenario = result.scenario
    return f"penalty {scenario.penalty:g}, {text.steps(scenario)} learning steps"


def _judged(claims: Iterable[JudgedClaim], *, judged: bool) -> Iterator[Row]:
    """Yield rows of the table of findings; a single run has no error, nothing is judged."""
    for one in claims:
        verdict = {0: "no", one.cases: "yes"}.get(
            one.holds, f"in {text.of(one.holds, one.cases)}"
        )
        yield {
            "claim": one.text,
            "from": one.source,
            "measured here": one.measured,
            "agrees": verdict if judged and one.cases else None,
        }
