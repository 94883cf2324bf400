# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's Tables 1 to 3: ours, the paper's, the exact values; which rows differ, and why."""

from collections.abc import Iterable, Mapping, Sequence

from sparse_coord_ros.experiments.report import analysis
from sparse_coord_ros.experiments.report.analysis import AGREE, errors_from
from sparse_coord_ros.experiments.report.charts import comparison
from sparse_coord_ros.experiments.report.entries import Entry, by_scenario, names, pick
from sparse_coord_ros.experiments.report.section import Section, common, failed, memory
from sparse_coord_ros.experiments.report.text import (
    TEXTS,
    Row,
    class_bound,
    exceptions,
    fixed,
    listed,
    optimum,
    pair,
    percent,
    signed,
    size,
)
from sparse_coord_ros.learn.evaluation import Measure
from sparse_coord_ros.solve.optimum import independent_bound
from sparse_coord_ros.solve.reference import shortest_path_reference

REWARDS = ("table1", "table3")
"""The experiments on rewards that the paper has numbers of."""

MARGIN = 0.5
"""By how much Coop. may stay below the better baseline and still count as at least as good."""

SAME = 0.01
"""Difference of rewards that counts as none."""

LITTLE = 0.1
"""Difference of rewards up to which there is next to nothing to coordinate."""

ARRIVE = 0.999
"""Share of trials in which every robot is to arrive."""

RARE = 0.05
"""COORDINATE per robot and episode below which a learner is said not to ask."""


def reward_section(entries: Sequence[Entry]) -> Section:
    """Return Table 1 or Table 3: the total discounted reward."""
    coop = pick(entries, learner="coop")
    shares = [entry.result.visited_share for entry in coop]
    sizes = [entry.result.visited_bytes for entry in coop]
    shown, same = _as_paper(entries, "reward")
    rejected = [e for e in shown if analysis.above_optimum(e) or analysis.contradicts_itself(e)]
    values = {
        "same": f"{len(same)} of {len(shown)}",
        "rejected": str(len(rejected)),
        "visited": f"{percent(min(shares))} to {percent(max(shares))}",
        "bytes": f"{size(min(sizes))} to {size(max(sizes))}",
        "silent": _silent(coop),
    }
    behaviour = [
        {
            "scenario": entry.name,
            "learner": entry.title,
            "all arrive": percent(entry.result.arrived, 2),
            "failed teams": failed([entry]),
            "COORDINATE (s.e.)": common(entry)["COORDINATE (s.e.)"],
            "visited": percent(entry.result.visited_share) if entry.can_ask else None,
            **memory(entry),
        }
        for entry in entries
    ]
    return Section(
        values | compared(entries)[0],
        [
            [{**_row(e, "reward", "reward"), **_bounds(e)} for e in entries],
            behaviour,
        ],
        [comparison(entries, ["reward"])],
        [(len(same), len(shown))],
        _misses(entries),
    )


def _bounds(entry: Entry) -> Row:
    """Return the columns on what can be reached."""
    best = class_bound(entry) if entry.can_ask else None
    return {"class bound": best, "joint optimum": optimum(entry)}


def _as_paper(entries: Iterable[Entry], measure: str) -> tuple[list[Entry], list[Entry]]:
    """Return the entries that the paper shows, and those of them that agree with it."""
    shown = [(entry, entry.paper(measure)) for entry in entries]
    known = [(entry, paper) for entry, paper in shown if paper]
    same = [entry for entry, paper in known if analysis.agrees(entry.measure(measure), paper)]
    return [entry for entry, _ in known], same


def _row(entry: Entry, measure: str, head: str = "ours") -> Row:
    ours, exact = entry.measure(measure), entry.result.reference[measure]
    known = entry.learner == "indiv"
    return {
        "scenario": entry.name,
        "learner": entry.title,
        head: pair(ours),
        "s.e.": fixed(ours.standard_error, 3),
        "paper": pair(entry.paper(measure)),
        "shortest paths, exact": f"{exact:.2f}" if known else None,
        "s.e. from exact": fixed(errors_from(ours, exact), 1, "+") if known else None,
    }


def _silent(coop: Sequence[Entry]) -> str:
    """Return why robots hardly ever ask, where they do not."""

    def to_gain(entry: Entry) -> float:
        return max(0.0, entry.result.optimum - entry.shortest_paths)

    silent = [entry for entry in coop if entry.measure("asks").mean < RARE]
    idle = [entry for entry in silent if to_gain(entry) <= LITTLE]
    rest = [entry for entry in silent if entry not in idle]
    alone = [entry for entry in rest if entry.result.optimum_exact and _is_shortest(entry)]
    other = [entry for entry in rest if entry not in alone]
    return "\n\n".join(
        TEXTS["silent"].format(
            names=listed([f"{entry.name} ({to_gain(entry):.2f})" for entry in own]),
            RARE=RARE,
            why=why.format(AGREE=AGREE),
        )
        for own, why in zip((idle, alone, other), TEXTS["silent_why"], strict=True)
        if own
    )


def _is_shortest(entry: Entry) -> bool:
    """Whether the reward agrees with the exact value of shortest-path policies.

    Where all runs came to the same route there is no standard error: equal routes may differ by
    less than `SAME`.
    """
    if abs(entry.measure("reward").mean - entry.shortest_paths) < SAME:
        return True
    return abs(errors_from(entry.measure("reward"), entry.shortest_paths)) <= AGREE


def compared(entries: Sequence[Entry]) -> tuple[dict[str, str], list[tuple[int, int]]]:
    """Return how Coop. fares against the baselines, Indiv. against exact values; who arrives.

    Returns: what the texts leave open, and for each of the three in how many cases it is as hoped.
    """
    below = []
    for own in by_scenario(entries):
        best = max((e for e in own if not e.can_ask), key=lambda e: e.measure("reward").mean)
        lead = analysis.difference(pick(own, learner="coop")[0], best)
        if lead.mean < -MARGIN:
            below.append(f"{best.name} {signed(lead)}")
    indiv = pick(entries, learner="indiv")
    far = [
        f"{e.name} ({fixed(errors_from(e.measure('reward'), e.shortest_paths), 1, '+')} s.e.)"
        for e in indiv
        if not _is_shortest(e)
    ]
    coop, total = pick(entries, learner="coop"), len(names(entries))
    arrived = sum(e.result.arrived * e.result.runs for e in coop) / sum(
        e.result.runs for e in coop
    )
    least = min(coop, key=lambda entry: entry.result.arrived)
    others = [pick(entries, learner=name) for name in ("indiv", "noncoop")]
    baselines = [f"{failed(own)} ({own[0].title})" for own in others]
    paired = " (differences with paired standard errors)" if below else ""
    return {
        "better": f"{total - len(below)} of {total}",
        "worse": f"{paired}{exceptions(below)}",
        "exact": f"{len(indiv) - len(far)} of {len(indiv)}",
        "far": exceptions(far),
        "arrived": percent(arrived, 2),
        "met": "met" if arrived >= ARRIVE else "not met",
        "least": f"{least.name} {percent(least.result.arrived, 2)}",
        "failed": failed(coop),
        "baselines": listed(baselines),
    }, [(total - len(below), total), (len(indiv) - len(far), len(indiv)), (arrived >= ARRIVE, 1)]


def table2_section(entries: Sequence[Entry]) -> Section:
    """Return Table 2: time to goal and miscoordinations."""
    values, agrees = {}, []
    for measure in ("time_to_goal", "miscoordinations"):
        shown, same = _as_paper(entries, measure)
        other = [
            f"{e.name} {e.title} (ours {e.measure(measure).mean:.2f}, paper {paper.mean:.2f})"
            for e in shown
            if e not in same and (paper := e.paper(measure))
        ]
        values[measure] = f"{len(same)} of {len(shown)}"
        values[f"not_{measure}"] = exceptions(other)
        agrees.append((len(same), len(shown)))
    coop = {e.name: e.measure("miscoordinations").mean for e in pick(entries, learner="coop")}
    values["coop"] = ", ".join(f"{name} {mean:.2f}" for name, mean in coop.items())
    agrees.append((list(coop.values()).count(0), len(coop)))
    rows = [
        {
            **_row(entry, "miscoordinations"),
            "COORDINATE": f"{entry.measure('asks').mean:.3f}" if entry.can_ask else None,
            "all arrive": percent(entry.result.arrived, 2),
        }
        for entry in entries
    ]
    figure = comparison(entries, ["time_to_goal", "miscoordinations"])
    times = [_row(entry, "time_to_goal") for entry in entries]
    return Section(values, [times, rows], [figure], agrees)


def _misses(entries: Iterable[Entry]) -> list[Row]:
    """Return the rows whose reward is not the paper's, or cannot be, each with the reason."""
    return [
        {
            "scenario": entry.name,
            "learner": entry.title,
            "ours": f"{entry.measure('reward').mean:.2f}",
            "paper": f"{paper.mean:.2f}",
            "why": _reason(entry, paper),
        }
        for entry in entries
        if (paper := entry.paper("reward"))
        and (
            analysis.above_optimum(entry)
            or analysis.contradicts_itself(entry)
            or not analysis.agrees(entry.measure("reward"), paper)
        )
    ]


def _reason(entry: Entry, paper: Measure) -> str:
    """Return why the paper's reward of a row is not reproduced."""
    texts: Mapping[str, str] = TEXTS["reasons"]
    best = entry.result.optimum
    bound = "exact joint optimum" if entry.result.optimum_exact else "upper bound of the optimum"
    alone = independent_bound(entry.scenario)
    ideal = abs(errors_from(paper, alone)) <= AGREE
    turning = _turning(entry)
    if analysis.above_optimum(entry):
        text = texts["above"] + texts["ideal"] * ideal
        return text.format(bound=bound, best=best, alone=alone)
    implied = analysis.implied_reward(entry)
    if implied and analysis.contradicts_itself(entry):
        counted, _ = entry.scenario.paper[entry.learner]["miscoordinations"]
        return texts["contradicts"].format(counted=counted, implied=implied.mean, turning=turning)
    if entry.learner == "indiv" and _is_shortest(entry):
        return texts["ties"].format(exact=entry.shortest_paths, turning=turning)
    text = texts["unknown"]
    if entry.can_ask and ideal:
        text = texts["pays"].format(alone=alone)
    elif entry.learner == "noncoop" and turning:
        text = f"{turning.strip()} "
    return text + texts["behind"].format(
        bound=bound,
        paper_share=percent(paper.mean / best),
        our_share=percent(entry.measure("reward").mean / best),
    )


def _turning(entry: Entry) -> str:
    """Return a sentence where the paper's miscoordinations are those of robots that keep right."""
    paper = entry.paper("miscoordinations")
    if paper is None:
        return ""
    same = shortest_path_reference(entry.scenario, turning="same")
    chance = entry.result.reference["miscoordinations"]
    alike = abs(errors_from(paper, same.miscoordinations)) <= AGREE
    if not alike or abs(errors_from(paper, chance)) <= AGREE:
        return ""
    text: str = TEXTS["reasons"]["turning"]
    return text.format(reward=same.reward, miscoordinations=same.miscoordinations, mean=paper.mean)


def provenances(entries: Sequence[Entry], misses: Iterable[Row]) -> str:
    """Return where the maps come from on which rows do not fit, a list with each text once."""
    maps: dict[str, list[str]] = {}
    for name in dict.fromkeys(str(row["scenario"]) for row in misses):
        maps.setdefault(pick(entries, name=name)[0].scenario.map.provenance, []).append(name)
    return "\n".join(f"- {listed(own)}: {text}." for text, own in maps.items() if text)
