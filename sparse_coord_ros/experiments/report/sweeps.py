# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is measured against a setting: Figure 4, the gap closed, and the paper's open questions."""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import chain, takewhile
from typing import Any

import numpy as np

from sparse_coord_ros.experiments.catalogue import CLOSED, FALLS, LEARNERS, LONG, REACHED
from sparse_coord_ros.experiments.report import analysis
from sparse_coord_ros.experiments.report.analysis import (
    difference,
    paired,
    run_means,
    surely_positive,
)
from sparse_coord_ros.experiments.report.charts import (
    ALL,
    BYTES,
    CLASS,
    FACTORED,
    GAIN,
    NONCOOP,
    ONE,
    SIGHT,
    Where,
    plot,
    point,
    points,
)
from sparse_coord_ros.experiments.report.entries import Entry, by_scenario, names, pick
from sparse_coord_ros.experiments.report.map_pictures import asked_maps
from sparse_coord_ros.experiments.report.section import Section, common, failed, memory
from sparse_coord_ros.experiments.report.text import (
    Row,
    class_bound,
    fixed,
    listed,
    optimum,
    percent,
    signed,
    size,
    steps,
    with_error,
)
from sparse_coord_ros.game.scenario import SETTINGS
from sparse_coord_ros.game.specs import Spec
from sparse_coord_ros.learn.evaluation import Measure
from sparse_coord_ros.learn.learners import learner_of

MEASURES = ("reward", "miscoordinations", "asks")
COLUMNS = ("closed", "closed from the better", "closed to the class bound")


def sweep(
    entries: Sequence[Entry],
    setting: str,
    value: Callable[[Entry], str],
    xlabel: str,
    values: dict[str, str],
    agrees: Sequence[tuple[int, int]],
    *,
    where: Sequence[tuple[Sequence[Entry], Where]] = (),
    measures: Sequence[str] = ("reward", "asks"),
    more: Sequence[Sequence[Row]] = (),
) -> Section:
    """Return the section on an experiment that measures learners against a setting.

    Args:
        entries: its conditions.
        setting: what the setting is called in the table.
        value: returns the setting of a condition.
        xlabel: what it is called in the figure.
        values: what the texts leave open.
        agrees: for each claim, in how many cases it holds, and of how many.
        where: which conditions are drawn, and where (see `figures.points`); else all of them, the
            values spaced evenly.
        measures: what is drawn, a line of panels each.
        more: further tables.
    """
    order = list(dict.fromkeys(map(value, entries)))
    several = len({entry.learner for entry in entries}) > 1

    def evenly(entry: Entry) -> dict[str, Any]:
        x, shift = order.index(value(entry)), _shift(entry) if several else 0.0
        return {"x": x, "tick": value(entry), "shift": shift, "xlabel": xlabel}

    rows = [
        {"scenario": e.name, "learner": e.title, setting: value(e), **common(e)} for e in entries
    ]
    drawn = where or [(entries, evenly)]
    shown = [p for own, place in drawn for name in measures for p in points(own, name, place)]
    return Section(values, [rows, *more], [plot(shown, len(names(entries)))], agrees)


def default_section(entries: Sequence[Entry]) -> Section:
    """Return a section on any experiment: its conditions by the settings in which they differ."""
    given = [entry.scenario for entry in entries]
    varied = [name for name in SETTINGS if len({str(getattr(s, name)) for s in given}) > 1]

    def value(entry: Entry) -> str:
        return ", ".join(f"{getattr(entry.scenario, name)}" for name in varied) or "-"

    setting = ", ".join(varied) or "setting"
    return sweep(entries, setting, value, setting, {}, [], measures=MEASURES)


def ask_cost_section(entries: Sequence[Entry]) -> Section:
    """Return reward and asks against the cost of COORDINATE."""
    asks, lines, less = [], [], []
    for own in by_scenario(entries):
        first, *_, last = own = sorted(own, key=lambda entry: entry.scenario.ask_cost)
        dear = list(takewhile(_worth_it, own))
        limit = "up to" if dear else "not even at"
        cost = (dear or own)[-1 if dear else 0].scenario.ask_cost
        ends = [f"{e.measure('asks').mean:.2f} at {e.scenario.ask_cost:g}" for e in (first, last)]
        asks.append(f"{first.name} {' and '.join(ends)}")
        lines.append(
            f"{asks[-1]} (more than {analysis.AGREE:g} standard errors above shortest paths "
            f"{limit} a cost of {cost:g})"
        )
        less.append(difference(first, last, "asks"))
    values = {"asks": "; ".join(asks), "lines": "; ".join(lines)}
    cost_of = "cost of COORDINATE"
    return sweep(
        entries, "cost", lambda e: f"{e.scenario.ask_cost:g}", cost_of, values, [_surely(less)]
    )


def _worth_it(entry: Entry) -> bool:
    """Whether the reward is surely above the exact value of shortest-path policies."""
    error = analysis.errors_from(entry.measure("reward"), entry.shortest_paths)
    return error > analysis.AGREE


def _surely(measures: Iterable[Measure]) -> tuple[int, int]:
    """Return how many measures surely exceed 0, and of how many."""
    found = [surely_positive(one) for one in measures]
    return sum(found), len(found)


def perception_section(entries: Sequence[Entry]) -> Section:
    """Return reward and asks against the success of the percept."""

    def spec(entry: Entry) -> Spec:
        return entry.scenario.perception

    def chance(entry: Entry) -> dict[str, Any]:
        return {"x": spec(entry).numbers[0], "xlabel": "probability of a percept"}

    def place(entry: Entry) -> dict[str, Any]:
        numbers = spec(entry).numbers
        return {
            "panel": f"{entry.name}, by place",
            "x": order.index(spec(entry)),
            "tick": f"{numbers[0]:g}" if numbers else "los",
            "line": entry.title if numbers else SIGHT,
            "xlabel": "range [cells], or line of sight",
        }

    drawn = [entry for entry in entries if spec(entry).kind == "probability"]
    placed = [entry for entry in entries if entry not in drawn]
    order = sorted({spec(e) for e in placed}, key=lambda one: one.numbers or (math.inf,))
    lines, gains = [], {}
    for own in by_scenario(drawn):
        ends = sorted(own, key=lambda entry: spec(entry).numbers)[:: len(own) - 1]
        texts = [f"{e.measure('reward').mean:.1f} at {spec(e).numbers[0]:g}" for e in ends]
        gain = gains[own[0].name] = difference(ends[1], ends[0])
        lines.append(f"{own[0].name} {' and '.join(texts)}, difference {signed(gain)}")
    return sweep(
        entries,
        "percept",
        lambda e: str(spec(e)),
        "",
        {
            "lines": "; ".join(lines),
            "gains": ", ".join(f"{name} {signed(gain)}" for name, gain in gains.items()),
        },
        [_surely(gains.values())],
        where=[(drawn, chance), (placed, place)],
    )


def uneven_section(entries: Sequence[Entry]) -> Section:
    """Return what uneven common rewards do."""
    gains: dict[str, Measure] = {}
    rows: list[Row] = []
    asking = []
    for coop in pick(entries, learner="coop"):
        spec, factors = coop.scenario.common_reward, _factors(coop)
        [base] = pick(entries, learner="noncoop", name=coop.name, common_reward=spec)
        gain = gains[f"{coop.name} {factors}"] = difference(coop, base)
        asks = coop.result.robot_means["asks"]
        if spec.numbers:
            asking.append(f"{coop.name} {' : '.join(f'{n:.2f}' for n in asks)} at {factors}")
        rows += [
            {
                "scenario": coop.name,
                "factors": factors,
                "robot": str(k + 1),
                "its factor": f"{(spec.numbers or (1.0,) * len(asks))[k]:g}",
                "reward, Non-coop.": f"{base.result.robot_means['reward'][k]:.2f}",
                "reward, Coop.": f"{coop.result.robot_means['reward'][k]:.2f}",
                "COORDINATE, Coop.": f"{asks[k]:.3f}",
                "gain of the team (s.e.)": None if k else signed(gain),
            }
            for k in range(len(asks))
        ]
    better = sum(gain.mean > 0 for gain in gains.values())
    sure = [f"{name}: {signed(gain)}" for name, gain in gains.items() if surely_positive(gain)]
    return sweep(
        entries,
        "factors",
        _factors,
        "factors of $r^C$, robot by robot",
        {
            "better": f"{better} of {len(gains)}",
            "sure": listed(sure),
            "count": str(len(sure)),
            "asking": "; ".join(asking),
        },
        [_surely(gains.values())],
        measures=MEASURES,
        more=[rows],
    )


def _factors(entry: Entry) -> str:
    spec = entry.scenario.common_reward
    return " : ".join(f"{factor:g}" for factor in spec.numbers) or spec.kind


def _shift(entry: Entry) -> float:
    """Return by how much a learner's points are moved, so that equal ones are all seen."""
    return 0.1 * (LEARNERS.index(entry.learner) - 1.5)


def crowd_section(entries: Sequence[Entry]) -> Section:
    """Return what more robots do, with one random peer and with all of them perceived."""
    lines = (NONCOOP, ONE, ALL, FACTORED)

    def line(entry: Entry) -> str:
        return {"one": ONE, "all": ALL}[entry.scenario.peers] if entry in coop else entry.title

    def where(entry: Entry, end: str = "") -> dict[str, Any]:
        x, shift = entry.result.robots, 0.12 * lines.index(line(entry)) - 0.18
        own = {"line": line(entry) + end, "xlabel": "robots", "tick": str(x)}
        return {"panel": "", "x": x, "shift": shift, **own}

    base, coop, factored = (
        pick(entries, learner=name) for name in ("noncoop", "coop", "factored")
    )
    one, every = (pick(coop, peers=peers) for peers in ("one", "all"))
    gains = [list(map(difference, own, base)) for own in (one, every, factored)]
    shown = points(entries, "reward", where) + points(entries, "loss", where)
    shown = [p for p in shown if p["line"] != CLASS]  # known for two robots only: no line
    for entry, gain in zip([*one, *every, *factored], chain(*gains), strict=True):
        shown.append(point(gain, GAIN, **where(entry)))
    asking = [*coop, *factored]
    shown += points(entries, "miscoordinations", where) + points(asking, "asks", where)
    for entry in factored:
        shown.append(point(Measure(entry.result.visited_bytes, 0, 0), BYTES, **where(entry)))
    for entry in coop:
        for count, end in ((entry.result.visited_bytes, ""), (entry.dense_bytes, ", dense table")):
            shown.append(point(Measure(count, 0, 0), BYTES, **where(entry, end)))
    rows = [
        {
            "robots": str(entry.result.robots),
            "learner, peers": line(entry),
            "reward (s.e.)": with_error(entry.measure("reward")),
            "loss": f"{analysis.loss_alone(entry).mean:.2f}",
            **common(entry),
            **memory(entry),
        }
        for entry in entries
    ]
    leads = [
        f"{entry.result.robots} robots {signed(a)}, {signed(b)} and {signed(c)}"
        for entry, a, b, c in zip(base, *gains, strict=True)
    ]
    counts = [_surely(own) for own in gains]
    values = {
        "robots": str(every[-1].result.robots),
        "dense": size(every[-1].dense_bytes),
        "visited": size(every[-1].result.visited_bytes),
        "lines": "; ".join(leads),
        "one": "{} of {}".format(*counts[0]),
        "all": "{} of {}".format(*counts[1]),
        "factored": "{} of {}".format(*counts[2]),
        "arrived": percent(min(e.result.arrived for e in factored), 2),
        "failed": failed(factored),
    }
    agrees = [_surely([*gains[0], *gains[1]]), counts[2]]
    return Section(values, [rows], [plot(shown, 3)], agrees)


def figure4_section(entries: Sequence[Entry]) -> Section:
    """Return Figure 4: reward and variance against the penalty."""
    budgets = {(entry.name, entry.scenario.steps): steps(entry) for entry in entries}
    groups = {
        (name, text): pick(entries, name=name, steps=budget)
        for name in names(entries)
        for (own, budget), text in budgets.items()
        if own == name
    }
    penalties = list(dict.fromkeys(entry.scenario.penalty for entry in entries))
    lines, less, coop_falls = [], [], []
    ratios: dict[str, float] = {}
    rows: list[Row] = []
    for (name, budget), group in groups.items():
        place, falls = {"scenario": name, "steps": budget}, {}
        learners = [name for name in LEARNERS if pick(group, learner=name)]
        for learner in learners:
            own = pick(group, learner=learner)
            first, last = _ends(own)
            falls[learner] = run_means(first) - run_means(last)
            rewards = {_tick(e): f"{e.measure('reward').mean:.2f}" for e in own}
            fall = {"fall (s.e.)": with_error(paired(falls[learner]))}
            rows.append({**place, "learner": own[0].title, **rewards, **fall})
        exact = max(0.0, first.result.optimum - last.result.optimum)
        known = f"{exact:.2f}" if first.result.optimum_exact else None
        best = {_tick(e): optimum(e) for e in own}
        bounds = {_tick(e): text for e in own if (text := class_bound(e))}
        bound = (first.class_bound or math.nan) - (last.class_bound or math.nan)
        if bounds:
            rows.append({**place, "learner": CLASS, **bounds, "fall (s.e.)": fixed(bound)})
        if bound > 0.0 and "factored" in falls and first.scenario.steps == LONG["steps"]:
            ratios[name] = falls["factored"].mean() / bound
        rows.append({**place, "learner": "joint optimum", **best, "fall (s.e.)": known})
        texts = [
            f"{learner_of(name).title} {with_error(paired(falls[name]), 1)}"
            for name in reversed(learners)
        ]
        texts += [f"{CLASS} {bound:.1f}"] * (bound >= 0.0)
        texts.append(f"optimum {exact:.1f}" if known else "optimum not known exactly")
        lines.append(f"- {name} ({budget} steps): {', '.join(texts)}")
        coop_falls.append(falls["coop"].mean())
        if _surely(paired(falls[n] - falls["coop"]) for n in ("indiv", "noncoop")) == (2, 2):
            less.append(f"{name} ({budget} steps)")

    def where(entry: Entry) -> dict[str, Any]:
        return {
            "panel": f"{entry.name}, {steps(entry)} steps",
            "x": penalties.index(entry.scenario.penalty),
            "tick": f"{abs(entry.scenario.penalty):g}",
            "shift": _shift(entry),
            "xlabel": "penalty (sign reversed)",
        }

    drawn = [entry for group in groups.values() for entry in group]
    values = {
        "lowest": f"{min(penalties):g}",
        "less": f"{len(less)} of {len(groups)}",
        "where": listed(less),
        "falls": "\n".join(lines),
        "least": f"{min(coop_falls):.1f}",
        "most": f"{max(coop_falls):.1f}",
        "ratios": ", ".join(f"{name} {ratio:.2f}" for name, ratio in ratios.items()) or "none",
        "limits": ", ".join(f"{name} {limit:g}" for name, limit in FALLS.items()),
    }
    within = sum(ratio <= FALLS.get(name, math.inf) for name, ratio in ratios.items())
    figures = [plot(points(drawn, name, where), 4, 3.0) for name in ("reward", "variance")]
    return Section(values, [rows], figures, [(len(less), len(groups)), (within, len(ratios))])


def _ends(entries: Iterable[Entry]) -> tuple[Entry, Entry]:
    """Return the entries of the least and of the greatest penalty."""
    ordered = sorted(entries, key=lambda entry: entry.scenario.penalty)
    return ordered[-1], ordered[0]


def _tick(entry: Entry) -> str:
    return f"{entry.scenario.penalty:g}"


def penalty100_section(entries: Sequence[Entry]) -> Section:
    """Return how much of the gap between the baselines and what can be reached is closed."""
    lines, met, reached = [], 0, 0
    rows: list[Row] = []
    closed_by: dict[str, str] = {}
    class_by: dict[str, str] = {}
    for own in by_scenario(entries):
        [coop], [base] = (pick(own, learner=learner) for learner in ("coop", "noncoop"))
        shares: dict[str, Row] = {}
        for entry in own:
            if not entry.can_ask:
                continue
            closed = partial(analysis.gap_closed, run_means(entry))
            share = harder = closed(run_means(base), optimum=entry.result.optimum)
            if entry.shortest_paths > base.measure("reward").mean:
                harder = closed(entry.shortest_paths, optimum=entry.result.optimum)
            bound = entry.class_bound
            reach = None if bound is None else closed(run_means(base), optimum=bound)
            text, above = map(_share, (share, harder))
            of_class = None if reach is None else _share(reach)
            shares[entry.learner] = {
                "closed": text,
                "closed from the better": above,
                "closed to the class bound": of_class,
            }
            if entry is coop:
                target = CLOSED.get(entry.name)
                met += share is not None and target is not None and share.mean >= target
                closed_by[entry.name] = text
                verdict = _verdict(share, target)
            else:
                target = REACHED.get(entry.name)
                reached += reach is not None and target is not None and reach.mean >= target
                class_by[entry.name] = of_class or "unknown"
                verdict = ""
            lines.append(
                f"{entry.name}, {entry.title} {text}{verdict}, {above} from the better of "
                f"Non-coop. and exact shortest paths, {of_class or 'an unknown share'} of the gap "
                f"to the class bound, every robot arrives in {percent(entry.result.arrived, 2)} "
                f"of trials, {failed([entry])} teams fail"
            )
        rows += [
            {
                "scenario": entry.name,
                "learner": entry.title,
                "reward (s.e.)": with_error(entry.measure("reward")),
                "shortest paths, exact": f"{entry.shortest_paths:.2f}",
                "class bound": class_bound(entry) if entry.can_ask else None,
                "joint optimum": optimum(entry),
                **shares.get(entry.learner, dict.fromkeys(COLUMNS)),
                **common(entry),
                "failed teams": failed([entry]),
            }
            for entry in own
        ]

    def where(entry: Entry) -> dict[str, Any]:
        title = f"{entry.name}\ngap closed: {closed_by[entry.name]}"
        return {"panel": title, "x": LEARNERS.index(entry.learner), "tick": entry.title}

    values = {
        "lines": "; ".join(lines),
        "closed": ", ".join(f"{name} {text}" for name, text in closed_by.items()),
        "targets": ", ".join(f"{name} {percent(CLOSED[name], 0)}" for name in closed_by),
        "reached": ", ".join(f"{name} {text}" for name, text in class_by.items()),
        "aims": ", ".join(f"{name} {percent(REACHED[name], 0)}" for name in class_by),
    }
    figure = plot(points(entries, "reward", where, span=0.3), len(closed_by))
    agrees = [(met, len(closed_by)), (reached, len(class_by))]
    return Section(values, [rows], [figure], agrees)


def _share(closed: Measure | None) -> str:
    if closed is None:
        return "no gap to close"
    return f"{percent(closed.mean)} ± {percent(closed.standard_error)}"


def _verdict(closed: Measure | None, target: float | None) -> str:
    """Return whether a target is met, in parentheses; judged by the mean."""
    if closed is None or target is None:
        return ""
    met = "met" if closed.mean >= target else "not met"
    if abs(closed.mean - target) < closed.standard_error:
        met += ", within its error"
    return f" (target {percent(target, 0)}: {met})"


def where_section(entries: Sequence[Entry]) -> Section:
    """Return where in the map COORDINATE is chosen: maps, and the share near doorways."""
    shares = {e.name: (analysis.asked_near(e), analysis.time_near(e)) for e in entries}
    near = {name: share for name, share in shares.items() if not math.isnan(share[0])}
    never = [name for name in shares if name not in near]
    apart = [share for share in near.values() if percent(share[1]) != percent(1.0)]
    more = sum(asked > time for asked, time in apart)
    texts = [f"{name} {percent(asked)} ({percent(time)})" for name, (asked, time) in near.items()]
    rows = [
        {
            "scenario": entry.name,
            "COORDINATE (s.e.)": with_error(entry.measure("asks"), 3),
            "asked near": percent(shares[entry.name][0]),
            "time near": percent(shares[entry.name][1]),
            "cells near": percent(float(np.mean(analysis.near_doorways(entry.scenario.map)))),
            "visited": percent(entry.result.visited_share),
        }
        for entry in entries
    ]
    values = {
        "shares": listed(texts),
        "more": str(more),
        "apart": str(len(apart)),
        "never": f" Never chosen in: {listed(never)}." if never else "",
    }
    return Section(values, [rows], [asked_maps(entries)], [(more, len(apart))])
