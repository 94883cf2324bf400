# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The studies of docs/known_map.md: robots that know their map, and teams that do not jam."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.solve.reference import shortest_path_reference
from sparse_coord_ros.core.solve.shipped import known_optimum
from sparse_coord_ros.studies.catalogue import unseen_conditions
from sparse_coord_ros.studies.conditions import make_condition
from sparse_coord_ros.studies.report.text import Row
from sparse_coord_ros.studies.standings import standing, standings
from tools.study import rules
from tools.study.coordination import Found, Rows, Study, return_and_failed

PRIORS = ("none", "map")

BUDGETS = {2: (2_000, 5_000, 10_000, 100_000), 4: (100_000,), 8: (100_000,)}
"""Step budgets, by robots."""


def _split(split: str) -> Callable[[Found], Rows]:
    """Return a function that yields how teams stand in the buildings of a split."""

    def table(found: Found) -> Iterator[Row]:
        for robots, budgets in BUDGETS.items():
            for steps in budgets:
                row = {"robots": f"{robots}", "steps": f"{steps:,}"}
                for prior in PRIORS:
                    settings = {"steps": steps, "prior": prior}
                    made = unseen_conditions("factored", split, settings, (robots,))
                    stood = standing([found(one) for one in made])
                    row |= {
                        f"prior={prior}": stood.share_and_failed(),
                        f"worst building, {prior}": percent(stood.worst),
                    }
                yield row

    return table


ABLATED: Mapping[str, tuple[str, Mapping[str, object]]] = {
    "all of it": ("factored", {}),
    "stand-offs are not left": (f"{rules.__name__}:NoWayOut", {}),
    "a surplus is not shared": (f"{rules.__name__}:WholeSurplus", {}),
    "no least worth": (f"{rules.__name__}:NoLeastWorth", {}),
    "none of the three": (f"{rules.__name__}:NoCures", {}),
    "all of it, prior=map": ("factored", {"prior": "map"}),
}
"""Learner and changed settings."""


def _ablation(found: Found) -> Rows:
    """Yield how larger teams stand without a part of the rule, in buildings for validation."""
    for what, (learner, settings) in ABLATED.items():
        row = {"what": what}
        for robots in (4, 8):
            made = unseen_conditions(learner, "validation", settings, (robots,))
            results = [found(one) for one in made]
            row[f"{robots} robots"] = standing(results).share_and_failed()
            kinds = standings(results, by_kind=True)
            for kind in ("corridor", "crossing"):
                stood = kinds[f"{robots}r {kind}"]
                row[f"{kind}, {robots}: failed"] = stood.of_teams(stood.failed)
        yield row


def _crowds(found: Found) -> Rows:
    """Yield what teams of the paper's and other maps earn, without and with the map."""
    for name in ("env2-4r", "crowd-4r", "crowd-6r", "crowd-8r"):
        row = {"scenario": name}
        for prior in PRIORS:
            settings = {"penalty": -100, "steps": 100_000, "prior": prior}
            one = found(make_condition(name, "factored", settings))
            row[f"prior={prior}"] = return_and_failed(one)
        yield row


CURVES = Path(__file__).resolve().parents[2] / "docs/figures/few_steps.png"
CURVE_STEPS = (500, 1_000, 2_000, 5_000, 10_000, 30_000, 100_000)
PAIRS = ("env1", "env2-2r", "isr", "mit", "pentagon", "cit", "suny", "cmu")
SCENARIOS = (*PAIRS[:2], "env2-4r", *PAIRS[2:])
CURVE_LEARNERS = ("coop", "noncoop", "factored", "cq", "joint")
COLOURS = dict(zip(CURVE_LEARNERS, ("C0", "C7", "C3", "C2", "C4"), strict=True))


def _curves(found: Found) -> Rows:
    """Draw return against steps, and yield the rows of the buildings for validation."""
    matplotlib.use("Agg")
    figure = Figure(figsize=(11, 11), layout="constrained")
    axes = figure.subplots(4, 3).flat
    for name, panel in zip(SCENARIOS, axes, strict=False):
        _draw_scenario(found, name, panel)
    shares = {}
    last = axes[len(SCENARIOS)]
    for learner, prior in _lines(2):
        points = []
        for steps in CURVE_STEPS:
            settings = {"steps": steps, "prior": prior}
            made = unseen_conditions(learner, "validation", settings, (2,))
            points.append(standing([found(one) for one in made]))
        shares[learner, prior] = points
        means = np.array([100 * one.share.mean for one in points])
        errors = np.array([100 * one.share.standard_error for one in points])
        _draw_line(last, learner, prior, means, errors)
    last.set_ylim(-50, 105)
    last.set_title("24 buildings for validation, 2 robots")
    last.set_ylabel("share of the gap, %")
    handles, labels = last.get_legend_handles_labels()
    for panel in axes[len(SCENARIOS) + 1 :]:
        panel.axis("off")
    axes[len(SCENARIOS) + 1].legend(handles, labels, loc="upper left", frameon=False)
    figure.supxlabel("steps of learning")
    figure.savefig(CURVES, dpi=110)
    for (learner, prior), points in shares.items():
        row = {"learner": learner, "prior": prior}
        for steps, one in zip(CURVE_STEPS, points, strict=True):
            share = one.share
            told = f"{100 * share.mean:.0f} ({100 * share.standard_error:.0f})"
            row[f"{steps:,}"] = f"{told}; {one.failed}"
        yield row


def _lines(robots: int) -> Iterator[tuple[str, str]]:
    """Yield learner and prior of each line of a panel."""
    for learner in CURVE_LEARNERS:
        for prior in PRIORS:
            if prior == "none" and learner_of(learner).needs_map:
                continue
            if learner == "joint" and robots > 2:
                continue
            yield learner, prior


def _draw_scenario(found: Found, name: str, panel: matplotlib.axes.Axes) -> None:
    scenario = load_scenario(name).with_settings({"penalty": -100})
    low = shortest_path_reference(scenario).returns
    best = known_optimum(scenario).value
    for learner, prior in _lines(len(scenario.robots)):
        given = {"penalty": -100, "prior": prior}
        results = [
            found(make_condition(name, learner, {**given, "steps": steps}))
            for steps in CURVE_STEPS
        ]
        returns = [one.best("returns") for one in results]
        means = np.array([one.mean for one in returns])
        errors = np.array([one.standard_error for one in returns])
        _draw_line(panel, learner, prior, means, errors)
    panel.axhline(low, color="black", lw=0.8, ls=":")
    panel.axhline(best, color="black", lw=0.8)
    least = min(low, best - 5.0)
    panel.set_ylim(least - 1.5 * (best - least) - 2.0, best + 0.1 * (best - least) + 1)
    panel.set_title(f"{name}, penalty -100")
    panel.set_ylabel("return of a robot")


def _draw_line(
    panel: matplotlib.axes.Axes,
    learner: str,
    prior: str,
    means: np.ndarray,
    errors: np.ndarray,
) -> None:
    style = "-" if prior == "map" else "--"
    colour = COLOURS[learner]
    label = f"{learner}, prior={prior}"
    panel.plot(CURVE_STEPS, means, style, color=colour, lw=1.4, label=label)
    panel.fill_between(
        CURVE_STEPS, means - errors, means + errors, color=colour, alpha=0.2, lw=0
    )
    panel.set_xscale("log")


FINAL_SEED = 2_600_000
VALIDATION_SEED = 2_500_000
PAGE = "known_map.md"

STUDIES: Sequence[Study] = (
    Study(
        "known-validation",
        (10, 10),
        500,
        _split("validation"),
        VALIDATION_SEED,
        PAGE,
    ),
    Study("known-test", (20, 20), 500, _split("test"), FINAL_SEED, PAGE),
    Study("known-ablation", (10, 10), 500, _ablation, VALIDATION_SEED, PAGE),
    Study("known-crowds", (40, 40), 300, _crowds, VALIDATION_SEED, PAGE),
    Study("few-steps", (10, 10), 200, _curves, VALIDATION_SEED, PAGE),
)
