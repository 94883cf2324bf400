# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pages that the build makes: one a scenario, one a learner, one a topic of the Python API.

They go into `generated/`, which is no part of the repository. What was learned is read from the
tables that `sparse_coord reproduce` made (`tables/`); nothing is computed but known optima.
"""

import inspect
import re
from importlib import import_module
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

import sparse_coord_ros as sc
from sparse_coord_ros import api
from sparse_coord_ros.cli.main import make_parser
from sparse_coord_ros.cli.verbs import VERBS, add_verb
from sparse_coord_ros.core.game.plugins import is_shipped
from sparse_coord_ros.core.learners.registry import LEARNERS, learner_of
from sparse_coord_ros.core.solve.shipped import yardsticks
from sparse_coord_ros.show.charts import rendered
from sparse_coord_ros.show.map_pictures import draw_map

HERE = Path(__file__).parent
FOLDER = HERE / "generated"
PENALTIES = (-20.0, -100.0)
"""Those of the paper's tables, and where coordination pays."""

BELOW = {
    "learners": (
        "Learners from within",
        ["core.learners.learner", "core.learners.mind"],
    ),
    "game": (
        "The game",
        [
            "core.game.scenario",
            "core.game.perception",
            "core.game.world",
        ],
    ),
    "measures": ("Measures", ["core.runs.evaluation", "core.runs.measures"]),
    "logs": ("Logs and bags", ["log.runlog", "log.bags"]),
}
"""Pages of modules below the names of `sparse_coord_ros`, which they leave out."""


def everything():
    """Write all pages; those that are as they were are not touched, so that builds are quick."""
    made = {**_scenarios(), **_learners(), **_api()}
    for name, text in made.items():
        path = FOLDER / name
        path.parent.mkdir(parents=True, exist_ok=True)
        data = text.encode() if isinstance(text, str) else text
        if not path.exists() or path.read_bytes() != data:
            path.write_bytes(data)
    for path in FOLDER.rglob("*.*"):
        if str(path.relative_to(FOLDER)) not in made:
            path.unlink()


def _contents(names):
    return "```{toctree}\n:maxdepth: 1\n\n" + "\n".join(names) + "\n```\n"


def _facts(facts):
    return _table(["", ""], [[f"**{k}**", v] for k, v in facts.items() if v], "---")


def _table(head, rows, rest="--:"):
    lines = [head, ["---"] + [rest] * (len(head) - 1), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def _results():
    """Return what is known of conditions in which nothing but penalty and steps was changed.

    Rows of learners of earlier versions are left out.
    """
    frames = [
        pd.read_csv(HERE / "tables" / f"{name}.csv") for name in ("figure4", "crowd")
    ]
    found = pd.concat(frames).drop_duplicates("condition")
    plain = found.condition.str.fullmatch(r"[^/]+/[^/]+/penalty=[^,]+(,steps=\d+)?")
    there = found.learner.isin(list(LEARNERS.registered))
    return found[plain & there & found.penalty.isin(PENALTIES)]


def _measures(row):
    return [f"{row[name]:.2f} ({row[f'{name}_error']:.2f})" for name in MEASURES]


MEASURES = ("returns", "time_to_goal", "miscoordinations", "asks")
HEAD = ["return", "time to goal", "miscoordinations", "asks"]
MEANS = (
    "Means of 100 learning runs, standard errors in brackets: return of a robot, "
    "steps to its goal, miscoordinations of an episode, questions of a robot."
)


def _scenarios():
    """Return the pages of the shipped scenarios and their pictures."""
    names = sc.scenario_names()
    results = _results()
    made = {}
    for name in names:
        scenario = sc.load_scenario(name)
        made[f"scenarios/{name}.svg"] = _picture(scenario)
        made[f"scenarios/{name}.md"] = _scenario(
            scenario, results[results.scenario == name]
        )
    text = (
        "Nine are the paper's. The crowds have two to eight robots in one building. Aisle, "
        "lane and floor-4r teach the kinds of interaction."
    )
    made["scenarios/index.md"] = f"# Scenarios\n\n{text}\n\n{_contents(names)}"
    return made


def _picture(scenario):
    rows, columns = scenario.map.shape
    scale = min(0.5, 10 / columns)
    figure = Figure(figsize=(columns * scale, rows * scale), layout="constrained")
    draw_map(figure.subplots(), scenario)
    return rendered(figure, "svg")


def _scenario(scenario, results):
    grid = scenario.map
    name = scenario.name
    facts = {
        "Map": f"{grid.title}; {grid.source}",
        "Where it is from": grid.provenance,
        "Cells": f"{len(grid.cells)}, of which {len(grid.doorways)} doorways",
        "Robots": ", ".join(
            f"{r.name} {grid.cells[r.start]} to {grid.cells[r.goal]}"
            for r in scenario.robots
        ),
        "Steps of learning": f"{scenario.steps:,}",
    }
    rows = []
    for (penalty, steps), own in results.groupby(["penalty", "steps"], sort=False):
        where = [f"{penalty:g}", f"{steps:,}"]
        rows += [[row.learner, *where, *_measures(row)] for _, row in own.iterrows()]
    known = []
    for penalty in PENALTIES:
        game = sc.load_scenario(name, penalty=penalty)
        paths = sc.shortest_paths(game).mean("returns")
        yards = [("shortest paths", paths), *yardsticks(game)]
        known += [[what, f"{penalty:g}", f"{value:.2f}"] for what, value in yards]
    return f"""# {name}

![Map of {name}]({name}.svg)

{_facts(facts)}

S is a robot's start, G its goal, an orange frame a doorway. Cells are (row, column).

## Load it

```python
scenario = sc.load_scenario("{name}")
run = sc.train(scenario, "coop")
```

```bash
sparse_coord train {name} --out runs/{name}
```

## What a team can be worth

{_table(["", "penalty", "return of a robot"], known)}

Robots on shortest paths ignore each other. Best asking team found: the best result of a search
among robots that learn each other's position only by asking; no upper bound. Joint optimum: one
controller sees all robots all the time, for free. With more than two robots it is unknown; the
bound is the value of each robot alone in the world.

## What was learned

{MEANS}

{_table(["learner", "penalty", "steps", *HEAD], rows)}
"""


def _learners():
    """Return the pages of the package's learners."""
    results = _results()
    made = {}
    names = [name for name, rule in LEARNERS.registered.items() if is_shipped(rule)]
    for name in names:
        rule = learner_of(name)
        made[f"learners/{name}.md"] = _learner(rule, results[results.learner == name])
    text = 'Each is chosen by its name: `--learner coop`, `sc.train(scenario, "coop")`.'
    made["learners/index.md"] = f"# Learners\n\n{text}\n\n{_contents(names)}"
    return made


def _learner(rule, results):
    kind = type(rule)
    module = inspect.getmodule(type(rule)).__name__
    facts = {
        "COORDINATE": "it can ask" if rule.asks else "it never asks",
        "Alone": "each robot learns with no other in the world; not live"
        if rule.alone
        else "",
        "Its defaults": ", ".join(f"`{k}={v}`" for k, v in rule.defaults.items()),
    }
    told = f".. automodule:: {module}\n   :no-members:\n   :no-index:"
    rows = [
        [
            f"[{row.scenario}](../scenarios/{row.scenario}.md)",
            f"{row.penalty:g}",
            f"{row.steps:,}",
        ]
        + _measures(row)
        for _, row in results.iterrows()
    ]
    table = _table(["scenario", "penalty", "steps", *HEAD], rows)
    learned = f"## What it learned\n\n{MEANS}\n\n{table}"
    return f"""# {rule.label}

{rule.summary}.

{_facts(facts)}

## Use it

```python
run = sc.train("env1", "{rule.label}")
```

```bash
sparse_coord train env1 --learner {rule.label} --out runs/{rule.label}
```

## How it learns

```{{eval-rst}}
{told}

.. autoclass:: {module}.{kind.__name__}
   :no-members:
   :no-index:

```

{learned if rows else ""}
"""


def _api():
    """Return a page for each topic of `sparse_coord_ros`, as its `__all__` is divided."""
    made = {}
    pages = []
    source = inspect.getsource(api)
    for title, lists in re.findall(
        r"^# (.+)\n((?:__all__ \+?= \[.*\]\n)+)", source, re.M
    ):
        page = re.sub(r"\W+", "_", title.lower())
        text = "\n".join(_named(name) for name in re.findall(r'"(\w+)"', lists))
        made[f"api/{page}.md"] = f"# {title}\n\n```{{eval-rst}}\n{text}\n```\n"
        pages.append(page)
    for page, (title, modules) in BELOW.items():
        text = "\n".join(_module(f"sparse_coord_ros.{name}") for name in modules)
        made[f"api/below_{page}.md"] = f"# {title}\n\n```{{eval-rst}}\n{text}\n```\n"
        pages.append(f"below_{page}")
    made["api/contents.txt"] = _contents(f"generated/api/{page}" for page in pages)
    return made


def _named(name):
    thing = getattr(sc, name)
    if inspect.ismodule(thing):
        return f".. automodule:: {thing.__name__}\n   :members:\n"
    how = "autoclass" if inspect.isclass(thing) else "autofunction"
    return f".. {how}:: sparse_coord_ros.{name}\n"


def _module(name):
    out = ", ".join(sc.__all__)
    members = (
        "imported-members"
        if Path(import_module(name).__file__).stem == "__init__"
        else "members"
    )
    return f".. automodule:: {name}\n   :{members}:\n   :exclude-members: {out}\n"


def every_verb():
    """Return the parser of all verbs with all their options, for the page of verbs."""
    parser = make_parser()
    verbs = parser._subparsers._group_actions[0]
    verbs.choices.clear()
    verbs._choices_actions.clear()
    for verb in VERBS:
        add_verb(verbs, verb)
    return parser
