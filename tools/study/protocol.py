# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The search for a learning protocol: what a learner leaves open, one for all scenarios.

A protocol is one value for each of a search's `choices`. Its loss adds up, in units of
reward, what is missed. The search tries some known protocols, then changes of the best so far and
a few drawn at random; the best are judged again with more runs, and every choice of the winner is
varied alone.
"""

import math
import random
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from sparse_coord_ros.experiments.catalogue import CLOSE, CLOSED, LARGE, LONG, SMALL, SPARSE
from sparse_coord_ros.experiments.conditions import Condition, make_condition
from sparse_coord_ros.experiments.report.text import Row, of, to_markdown
from sparse_coord_ros.experiments.store import ConditionResult, Plan
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.solve.shipped import shipped_class_bound
from sparse_coord_ros.version import __version__

Choices = Mapping[str, float]
"""One value for each choice."""

Found = Callable[[Condition], ConditionResult]
"""Returns the result of a condition."""

SETTINGS = (
    "step_size",
    "epsilon",
    "starts",
    "q_star_init",
    "q_coord_init",
    "goal_value",
    "max_steps",
)
"""The scenario settings that make up a protocol."""

MARGIN = 0.02
"""How much more of the gap the search for Coop. asks for, as its estimates are noisy."""

HOPELESS = 20.0
"""A change of one choice is not judged to the end once it loses this much more."""

FINALISTS = 6
"""Protocols that are judged again, with more runs and other seeds: the best of many noisy
estimates is often a lucky one."""

FINAL_RUNS = 3
"""How many times as many runs."""

FINAL_SEEDS = 10**6
"""How far their seeds lie from those of the search."""

KEPT = 4
"""Protocols whose choices the search goes on from."""

FRESH = 0.1
"""Share of protocols drawn at random."""

CHANGED = 0.25
"""Probability that a choice of a good protocol is drawn again."""


def settings_of(choices: Choices) -> dict[str, str]:
    """Return the scenario settings of a protocol."""
    c = {name: f"{value:g}" for name, value in choices.items()}
    schedules = {
        "step_size": f"floored:{c['exponent']}:{c['floor_first']}:{c['floor_last']}",
        "epsilon": f"linear:{c['epsilon_first']}:{c['epsilon_last']}:{c['epsilon_fraction']}",
        "starts": f"exploring:1:{c['starts_last']}:{c['starts_fraction']}",
    }
    return schedules | {name: c[name] for name in SETTINGS if name in c}


@dataclass
class Judgement:
    """What a protocol brought.

    Attributes:
        choices: the protocol.
        loss: summed shortfalls, in units of reward; 0: nothing is missed.
        whole: False where the search stopped early, as the loss was too large already.
        closed: share of the gap closed at penalty -100 and 10^5 steps, by scenario.
        difference: reward less that of what it is compared with, by condition.
        asks: COORDINATE per robot and trial where none is needed, by scenario.
        failed_teams: teams that do not all arrive in 99.9 % of their trials.
        teams: teams that learned.
    """

    choices: Choices
    loss: float = 0.0
    whole: bool = False
    closed: dict[str, float] = field(default_factory=dict)
    difference: dict[str, float] = field(default_factory=dict)
    asks: dict[str, float] = field(default_factory=dict)
    failed_teams: int = 0
    teams: int = 0

    def of_teams(self, result: ConditionResult) -> float:
        """Count the teams of a condition that was judged; return the loss by those that failed."""
        self.failed_teams += result.failed_teams
        self.teams += result.runs
        return 100.0 * result.failed_teams / result.runs

    @property
    def told_loss(self) -> str:
        """The loss as a text; where it was not judged to the end, what it is over."""
        return f"{self.loss:.2f}" if self.whole else f"> {self.loss:.0f}"


@dataclass(frozen=True)
class Search:
    """The search for the protocol of a learner; its texts are those of docs/protocol.md.

    Attributes:
        learner: whose protocol it is.
        choices: the values of each choice, and its value in the protocols that are tried first.
        titles: what these are called.
        losses: yields what a protocol misses, one condition after the other, and notes it.
        row: returns what a table says of a protocol, by column.
        candidates: how many protocols are tried.
        plan: seed, runs and trials of the conditions.
    """

    learner: str
    choices: Mapping[str, tuple[tuple[float, ...], float, float]]
    titles: tuple[str, str]
    losses: Callable[[Judgement, Found], Iterator[float]]
    row: Callable[[Judgement], Row]
    candidates: int
    plan: Plan

    page = "protocol.md"

    @property
    def name(self) -> str:
        """What the command line calls it."""
        return f"protocol-{self.learner}"

    @property
    def starts(self) -> dict[str, dict[str, float]]:
        """The protocols that are tried first, by their titles."""
        first = {name: value for name, (_, value, _) in self.choices.items()}
        second = {name: value for name, (_, _, value) in self.choices.items()}
        return dict(zip(self.titles, (first, second), strict=True))

    @property
    def final_plan(self) -> Plan:
        """Seed, runs and trials of the final."""
        seed, runs = self.plan.seed + FINAL_SEEDS, FINAL_RUNS * self.plan.runs
        return replace(self.plan, seed=seed, runs=runs)

    def judge(self, choices: Choices, found: Found, limit: float = math.inf) -> Judgement:
        """Return what a protocol brings; stop early once its loss exceeds a limit."""
        outcome = Judgement(choices)
        for loss in self.losses(outcome, found):
            outcome.loss += loss
            if outcome.loss > limit:
                return outcome
        outcome.whole = True
        return outcome

    def search(self, found: Found, seed: int = 0) -> Iterator[Judgement]:
        """Yield the outcome of each protocol tried, known ones first.

        Then protocols are drawn at random until `KEPT` of them were judged whole; from then on
        most are changes of the best ones.
        """
        draw = random.Random(seed)
        best: list[Judgement] = []
        first = list(self.starts.values())
        seen: set[tuple[float, ...]] = set()
        for number in range(self.candidates):
            choices = first[min(number, len(first) - 1)]
            while tuple(choices.values()) in seen:
                fresh = len(best) < KEPT or draw.random() < FRESH
                kept = {} if fresh else draw.choice(best).choices
                choices = {
                    name: draw.choice(values) if fresh or draw.random() < CHANGED else kept[name]
                    for name, (values, *_) in self.choices.items()
                }
            seen.add(tuple(choices.values()))
            limit = 1.3 * best[KEPT - 1].loss + 1.0 if len(best) >= KEPT else math.inf
            outcome = self.judge(choices, found, limit)
            yield outcome
            if outcome.whole:
                best = sorted([*best, outcome], key=_by_loss)[:KEPT]

    def final(self, outcomes: Iterable[Judgement], found: Found) -> list[Judgement]:
        """Judge the best protocols of a search again; return them, the best first."""
        whole = sorted((one for one in outcomes if one.whole), key=_by_loss)
        return sorted((self.judge(o.choices, found) for o in whole[:FINALISTS]), key=_by_loss)

    def vary(self, best: Judgement, found: Found) -> Iterator[tuple[str, float, Judgement]]:
        """Yield name, new value and outcome of every change of one choice of a protocol."""
        for name, (values, *_) in self.choices.items():
            for value in values:
                if value != best.choices[name]:
                    changed = {**best.choices, name: value}
                    yield name, value, self.judge(changed, found, best.loss + HOPELESS)

    def texts(self, compute: Callable[[Condition, Plan], ConditionResult]) -> dict[str, str]:
        """Search, judge the best again, vary the winner; return what the document says of it."""

        def searched(condition: Condition) -> ConditionResult:
            return compute(condition, self.plan)

        tried = list(self.search(searched))
        finalists = self.final(tried, lambda condition: compute(condition, self.final_plan))
        best = finalists[0].choices
        reference = self.judge(best, searched)
        others: dict[str, list[str]] = {}
        for name, value, one in self.vary(reference, searched):
            others.setdefault(name, []).append(f"{value:g}: {one.told_loss}")
        choices: list[Row] = [
            {
                "choice": name,
                "values": ", ".join(f"{value:g}" for value in values),
                **{title: f"{start[name]:g}" for title, start in self.starts.items()},
                "found": f"**{best[name]:g}**",
            }
            for name, (values, *_) in self.choices.items()
        ]
        final: list[Row] = [
            {"what differs from the protocol found": _changes(best, one.choices), **self.row(one)}
            for one in finalists
        ]
        varied: list[Row] = [{"choice": n, "loss with": ", ".join(o)} for n, o in others.items()]
        return {
            f"{self.learner}, found": self._summary(tried, best),
            f"{self.learner}, choices": to_markdown(choices),
            f"{self.learner}, search": to_markdown(self._progress(tried)),
            f"{self.learner}, final": to_markdown(final),
            f"{self.learner}, one choice": f"Without a change: {reference.told_loss}.\n\n"
            + to_markdown(varied),
        }

    def _summary(self, tried: Sequence[Judgement], best: Choices) -> str:
        default = learner_of(self.learner).with_defaults(load_scenario("env1"))
        settings, plan, final = settings_of(best), self.plan, self.final_plan
        told = "\n".join(f"{name}: {value}" for name, value in settings.items())
        return (
            f"{len(tried)} protocols were tried, {sum(one.whole for one in tried)} of them to the "
            f"end, with {plan.runs} learning runs of {plan.trials} trials in each scenario and "
            f"seeds from {plan.seed}; the final had {final.runs} runs and seeds from {final.seed} "
            f"(version {__version__}). This one was found. It is "
            f"{'' if default.with_settings(settings) == default else 'not '}the default:\n\n"
            f"```yaml\n{told}\n```\n"
        )

    def _progress(self, tried: Sequence[Judgement]) -> list[Row]:
        """Return a row for each protocol that was better than all before it."""
        rows: list[Row] = []
        best: Judgement | None = None
        for number, one in enumerate(tried):
            if one.whole and (best is None or one.loss < best.loss):
                change = _changes(best.choices, one.choices) if best else self.titles[0]
                rows.append({"number": str(number), "change": change, **self.row(one)})
                best = one
        return rows


def _by_loss(one: Judgement) -> float:
    return one.loss


def _changes(old: Choices, new: Choices) -> str:
    changed = [f"{name} {new[name]:g}" for name in new if new[name] != old[name]]
    return ", ".join(changed) or "-"


COOP_CHOICES: Mapping[str, tuple[tuple[float, ...], float, float]] = {
    "exponent": ((0.4, 0.5, 0.6, 0.8, 1), 0.6, 0.5),
    "floor_first": ((0, 0.05, 0.1, 0.15, 0.2, 0.3), 0, 0.1),
    "floor_last": ((0, 0.005, 0.01, 0.02), 0, 0.01),
    "epsilon_first": ((0.1, 0.15, 0.2, 0.3, 0.5, 1), 1, 0.15),
    "epsilon_last": ((0.01, 0.02, 0.05, 0.1), 0.05, 0.02),
    "epsilon_fraction": ((0.5, 0.8, 1), 1, 0.8),
    "starts_last": ((0, 0.1, 0.2, 0.3, 0.5, 1), 1, 0.2),
    "starts_fraction": ((0.5, 0.8, 1), 1, 0.5),
    "q_star_init": ((0, 10, 15, 20, 30), 0, 20),
    "q_coord_init": ((0, 100, 200), 200, 200),
    "goal_value": ((0, 200), 200, 200),
    "max_steps": ((50, 100, 200, 1000), 1000, 100),
}
"""What Algorithm 1 leaves open: the values tried, the textbook's (step sizes that decay with the
visits, epsilon from 1, exploring starts throughout), and the best that earlier searches of this
kind, with fewer runs and other seeds, came to."""


def coop_losses(outcome: Judgement, found: Found) -> Iterator[float]:
    """Yield what a protocol of Coop. misses of the goals that it is to reach everywhere."""

    def result_of(name: str, learner: str, settings: Mapping[str, object]) -> ConditionResult:
        given = {**settings_of(outcome.choices), **settings}
        return found(make_condition(name, learner, given))

    for name in CLOSE:
        result = result_of(name, "coop", LONG)
        low = result_of(name, "noncoop", LONG).measure("reward").mean
        closed = (result.measure("reward").mean - low) / (result.optimum - low)
        outcome.closed[name] = closed
        yield outcome.of_teams(result) + 40.0 * max(0.0, CLOSED[name] + MARGIN - closed)
    for name in SMALL + LARGE:
        result = result_of(name, "coop", {"penalty": -20})
        baseline = result.reference["reward"]
        if name in SMALL:  # in the large ones Non-coop. is worth the shortest paths
            other = result_of(name, "noncoop", {"penalty": -20})
            baseline = max(baseline, other.measure("reward").mean)
        outcome.difference[name] = result.measure("reward").mean - baseline
        loss = outcome.of_teams(result) + 2.0 * max(0.0, -0.3 - outcome.difference[name])
        if name in SPARSE:
            outcome.asks[name] = result.measure("asks").mean
            loss += 20.0 * max(0.0, outcome.asks[name] - 0.03)
        yield loss


def coop_row(one: Judgement) -> Row:
    """Return what a table says of a protocol of Coop."""
    worst = min(one.difference, key=lambda name: one.difference[name]) if one.whole else ""
    return {
        "loss": one.told_loss,
        **{f"{name} closed": f"{one.closed[name]:.0%}" for name in CLOSE if name in one.closed},
        "worst difference": f"{one.difference[worst]:+.2f} ({worst})" if one.whole else None,
        "most asks": f"{max(one.asks.values()):.3f}" if one.whole else None,
        "failed teams": of(one.failed_teams, one.teams),
    }


FACTORED_CHOICES: Mapping[str, tuple[tuple[float, ...], float, float]] = {
    "exponent": ((0.4, 0.5, 0.6, 0.8), 0.5, 0.5),
    "floor_first": ((0.05, 0.1, 0.2), 0.1, 0.1),
    "floor_last": ((0, 0.005, 0.01, 0.02), 0.01, 0.01),
    "epsilon_first": ((0.15, 0.2, 0.3, 0.5), 0.3, 0.15),
    "epsilon_last": ((0, 0.01, 0.02, 0.05), 0.02, 0.02),
    "epsilon_fraction": ((0.5, 0.8, 1), 0.8, 0.8),
    "starts_last": ((0, 0.1, 0.2), 0, 0.2),
    "starts_fraction": ((0.25, 0.5, 0.8), 0.5, 0.5),
    "q_coord_init": ((0, 100, 200), 200, 200),
    "max_steps": ((50, 100, 200), 100, 100),
}
"""What the factored learner leaves open: the values tried, its default, and Coop.'s choice. U
begins at `q_coord_init`."""

JUDGED: Mapping[str, tuple[str, Mapping[str, object]]] = {
    **{f"{name} -100": (name, LONG) for name in CLOSE},
    **{f"{name} -20": (name, {"penalty": -20}) for name in ("env1", "env2-2r", "cmu")},
    **{f"{name} -100": (name, LONG) for name in ("isr", "cit", "cmu", "env2-4r")},
}
"""Where its protocols are judged: at -100 with 10^5 steps, at -20 with the paper's budgets."""


def factored_losses(outcome: Judgement, found: Found) -> Iterator[float]:
    """Yield what is missing to the class bound; of more robots, to robots that never meet."""
    for text, (name, settings) in JUDGED.items():
        given = {**settings_of(outcome.choices), **settings}
        condition = make_condition(name, "factored", given)
        result, bound = found(condition), shipped_class_bound(condition.scenario)
        best = result.optimum if bound is None else bound.value
        outcome.difference[text] = result.best("reward").mean - best
        yield outcome.of_teams(result) - outcome.difference[text]


def factored_row(one: Judgement) -> Row:
    """Return what a table says of a protocol of the factored learner."""
    missing = {text: f"{-value:.2f}" for text, value in one.difference.items()}
    failed = of(one.failed_teams, one.teams)
    return {"loss": one.told_loss, **missing, "failed teams": failed}


COOP = Search(
    "coop",
    COOP_CHOICES,
    ("the textbook protocol", "the best of earlier searches"),
    coop_losses,
    coop_row,
    40,
    Plan(10_000, 100, 100),
)
FACTORED = Search(
    "factored",
    FACTORED_CHOICES,
    ("the learner's defaults", "Coop.'s protocol"),
    factored_losses,
    factored_row,
    12,
    Plan(20_000, 20, 50),
)
