# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`reproduction.md`, and the files of tables and figures beside it."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import jinja2

from sparse_coord_ros.experiments.catalogue import NAMES, Experiment
from sparse_coord_ros.experiments.report import analysis, text
from sparse_coord_ros.experiments.report.charts import save
from sparse_coord_ros.experiments.report.drawings import figures_of
from sparse_coord_ros.experiments.report.reasons import misses, provenances
from sparse_coord_ros.experiments.report.rows import names, to_csv
from sparse_coord_ros.experiments.report.sections import SECTIONS, JudgedClaim, reward_claims
from sparse_coord_ros.experiments.report.text import Row
from sparse_coord_ros.experiments.store import ConditionResult, Plan, write_result
from sparse_coord_ros.version import __version__

REWARDS = ("table1", "table3")
"""The experiments on rewards that the paper has numbers of."""


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
    found.filters |= {"table": text.to_markdown, "listed": text.listed, "named": text.named}
    return found


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
    pages = templates(Path(__file__).with_name("templates"))
    results = {one.name: [found[each.id] for each in one.conditions] for one in chosen}
    rewards = [name for name in REWARDS if name in results]
    shown = [one for name in rewards for one in results[name]]
    source = f"Table{'s' * (len(rewards) - 1)} {' and '.join(name[-1] for name in rewards)}"
    claims = reward_claims(source, shown) if shown else []
    parts = []
    for one in chosen:
        own = results[one.name]
        section = SECTIONS[one.name](own)
        claims += section.claims
        write_result(directory / f"tables/{one.name}.csv", to_csv(own))
        figures = figures_of(one.name, own)
        for name, figure in figures.items():
            save(figure, directory / f"figures/{name}")
        page = pages.get_template(f"{one.name}.md.j2")
        parts.append(
            page.render(
                name=one.name,
                title=one.title,
                rows=section.rows,
                figures=list(figures),
                scenarios=names(own),
                game=_game(own[0]),
                AGREE=f"{analysis.AGREE:g}",
                NEAR=analysis.NEAR,
                RARE=analysis.RARE,
                **section.values,
            )
        )
    missed = misses(shown)
    whole = tuple(results) == NAMES
    whole_page = pages.get_template("reproduction.md.j2").render(
        version=__version__,
        plan=plan,
        whole=whole,
        names="" if whole else " ".join([*results, ""]),
        AGREE=f"{analysis.AGREE:g}",
        claims=list(_findings(claims, judged=plan.runs > 1)),
        parts=parts,
        misses=missed,
        maps=provenances(shown, missed),
    )
    write_result(directory / "reproduction.md", whole_page)


def _game(result: ConditionResult) -> str:
    scenario = result.scenario
    return f"penalty {scenario.penalty:g}, {text.steps(scenario)} learning steps"


def _findings(claims: Iterable[JudgedClaim], *, judged: bool) -> Iterator[Row]:
    """Yield rows of the table of findings; a single run has no error, nothing is judged."""
    for one in claims:
        verdict = {0: "no", one.cases: "yes"}.get(one.holds, f"in {text.of(one.holds, one.cases)}")
        yield {
            "claim": one.text,
            "from": one.source,
            "measured here": one.measured,
            "agrees": verdict if judged else None,
        }
