# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's Tables 1 to 3: ours, the paper's, the exact values."""

from collections.abc import Sequence

from sparse_coord_ros.engine.report.analysis import (
    AGREE,
    agrees,
    difference,
    errors_from,
)
from sparse_coord_ros.engine.report.entries import LEARNER_NAMES, Entries, Entry
from sparse_coord_ros.engine.report.figures import comparison
from sparse_coord_ros.engine.report.misses import misses, versus
from sparse_coord_ros.engine.report.section import Picture, Section, game
from sparse_coord_ros.engine.report.tables import (
    NOTHING,
    Table,
    behaviour,
    exceptions,
    listed,
    optimum,
    pair,
    percent,
    signed,
    size,
)

MARGIN = 0.5
"""By how much Coop. may stay below the better baseline and still count as at least as good."""

LITTLE = 0.1
"""Difference of rewards up to which there is next to nothing to coordinate."""

ARRIVE = 0.999
"""Share of trials in which every robot is to arrive."""

RARE = 0.05
"""COORDINATE per robot and episode below which a learner is said not to ask."""

EXACT = "shortest paths, exact"


def reward_section(name: str, entries: Entries) -> Section:
    """Return Table 1 or Table 3: the total discounted reward."""
    rows = [[*_row(entry, "reward"), optimum(entry)] for entry in entries]
    head = ["scenario", "learner", "reward", "s.e.", "paper", EXACT, "s.e. from exact"]
    values = Table(
        f"Total discounted reward, averaged over the robots ({game(entries[0])}).",
        [*head, "joint optimum"],
        rows,
    )
    coop = entries.pick(learner="coop")
    shares = [entry.result.visited_share for entry in coop]
    picture = Picture(
        name,
        "Total discounted reward: ours (filled) and the paper's (hollow), bars: spread over "
        "single robots. Black: joint optimum (dashed: exact, dotted: upper bound). Grey: exact "
        "value of shortest-path policies.",
        comparison(entries, ["reward"]),
    )
    sparsity = (
        f"Q^C of a robot has updated {percent(min(shares))} to {percent(max(shares))} of the "
        f"joint states, {size(min(e.result.visited_bytes for e in coop))} to "
        f"{size(max(e.result.visited_bytes for e in coop))} a robot. A joint state counts as soon "
        "as it was updated once, exploration while learning included."
    )
    return Section(
        "Each learner's greedy policy is evaluated in the original problem, all robots moving at "
        "once. For Indiv. the exact value of fixed shortest-path policies is known, "
        "ties between equally short paths broken at random; the column after it says how many "
        "standard errors our mean lies from it.",
        [values, behaviour(entries)],
        [picture],
        [sparsity, *_silent(coop)],
        [
            *_compared(name, entries),
            _arrival(_title(name), entries),
        ],
        misses(entries),
    )


def _silent(coop: Entries) -> list[str]:
    silent = [entry for entry in coop if entry.measure("asks").mean < RARE]
    idle = [entry for entry in silent if _to_gain(entry) <= LITTLE]
    alone = [e for e in silent if e not in idle and e.result.optimum_exact and _as_shortest(e)]
    other = [e for e in silent if e not in idle and e not in alone]
    rare = f"Coop. chooses COORDINATE less than {RARE} times per robot and episode"
    most = "by how much the joint optimum (or its bound) exceeds shortest-path policies"
    text = []
    if idle:
        text.append(
            f"In {_with_gains(idle)} {rare}, and coordination can gain next to nothing: in "
            f"parentheses {most}."
        )
    if alone:
        text.append(
            f"In {_with_gains(alone)} {rare}, and its reward is that of shortest-path policies "
            f"within {AGREE:g} standard errors, although coordination could gain more: in "
            f"parentheses {most}. A robot that asks pays the cost and the delay alone, while all "
            "robots gain from a miscoordination avoided; where its own share of the gain is less, "
            "independent learners settle on not asking."
        )
    if other:
        text.append(
            f"In {_with_gains(other)} {rare}; coordination can gain at most the number in "
            f"parentheses, {most}."
        )
    return text


def _to_gain(entry: Entry) -> float:
    """Return by how much the optimum (or its bound) exceeds shortest-path policies."""
    return max(0.0, entry.result.optimum - entry.result.reference["reward"])


def _as_shortest(entry: Entry) -> bool:
    """Whether the reward agrees with the exact value of shortest-path policies."""
    return abs(errors_from(entry.measure("reward"), entry.result.reference["reward"])) <= AGREE


def _with_gains(entries: Sequence[Entry]) -> str:
    return listed([f"{entry.name} ({_to_gain(entry):.2f})" for entry in entries])


def _arrival(title: str, entries: Entries) -> str:
    """Return how reliably robots arrive: the share of trials, and the teams that fail more."""
    counts = {
        learner: (sum(e.result.failed_teams for e in own), sum(e.result.runs for e in own))
        for learner in entries.learners
        for own in [entries.pick(learner=learner)]
    }
    coop = entries.pick(learner="coop")
    arrived = sum(e.result.arrived * e.result.runs for e in coop) / counts["coop"][1]
    met = "met" if arrived >= ARRIVE else "not met"
    least = min(coop, key=lambda entry: entry.result.arrived)
    baselines = listed(
        [
            f"{failed} of {teams} ({LEARNER_NAMES[learner]})"
            for learner, (failed, teams) in counts.items()
            if learner != "coop"
        ]
    )
    return (
        f"{title}: with Coop. every robot arrives in {percent(arrived, 2)} of the trials (target: "
        f"at least {percent(ARRIVE)}, {met}; least: {least.name} "
        f"{percent(least.result.arrived, 2)}); in {counts['coop'][0]} of {counts['coop'][1]} "
        "Coop. teams some robot fails to arrive in more than one trial of a thousand. Of the "
        f"baselines' teams {baselines} fail so."
    )


def table2_section(name: str, entries: Entries) -> Section:
    """Return Table 2: time to goal and miscoordinations."""
    head = ["scenario", "learner", "ours", "s.e.", "paper", EXACT, "s.e. from exact"]
    tables = [
        Table(
            f"Time to goal in steps ({game(entries[0])}).",
            head,
            [_row(entry, "time_to_goal") for entry in entries],
        ),
        Table(
            f"Miscoordinations per episode ({game(entries[0])}).",
            [*head, "COORDINATE", "all arrive"],
            [
                [
                    *_row(entry, "miscoordinations"),
                    f"{entry.measure('asks').mean:.3f}"
                    if entry.cell.learner == "coop"
                    else NOTHING,
                    percent(entry.result.arrived, 2),
                ]
                for entry in entries
            ],
        ),
    ]
    findings = []
    for measure, word in (
        ("time_to_goal", "time to goal"),
        ("miscoordinations", "miscoordinations"),
    ):
        shown = [entry for entry in entries if entry.paper(measure)]
        same = [e for e in shown if agrees(e.measure(measure), e.paper(measure))]
        other = [versus(e, measure) for e in shown if e not in same]
        findings.append(
            f"{_title(name)}: {word} as in the paper, within {AGREE:g} standard errors of the "
            f"difference, in {len(same)} of {len(shown)} rows{exceptions(other)}"
        )
    return Section(
        "Time to goal is the number of steps until a robot arrives, the horizon where it does "
        "not; a miscoordination is a step at whose end two or more robots are in the same "
        "doorway. COORDINATE: choices per robot and episode.",
        tables,
        [
            Picture(
                name,
                "Time to goal and miscoordinations: ours (filled) and the paper's (hollow), bars: "
                "spread. Grey: exact value of shortest-path policies.",
                comparison(entries, ["time_to_goal", "miscoordinations"]),
            )
        ],
        findings=findings,
    )


def _title(name: str) -> str:
    return name.replace("table", "Table ")


def _row(entry: Entry, measure: str) -> list[str]:
    ours = entry.measure(measure)
    row = [entry.name, entry.learner, pair(ours), f"{ours.standard_error:.3f}"]
    row.append(pair(entry.paper(measure)))
    if entry.cell.learner != "indiv":
        return [*row, NOTHING, NOTHING]
    exact = entry.result.reference[measure]
    return [*row, f"{exact:.2f}", f"{errors_from(ours, exact):+.1f}"]


def _better_baseline(entries: Entries, name: str) -> Entry:
    """Return Indiv. or Non-coop. of a scenario, whichever has the greater reward."""
    baselines = [e for e in entries.pick(name) if e.cell.learner != "coop"]
    return max(baselines, key=lambda entry: entry.measure("reward").mean)


def as_good_as_baselines(title: str, entries: Entries) -> str:
    """Return in how many scenarios Coop. is about as good as the better baseline."""
    below = []
    for name in entries.names:
        lead = difference(entries.pick(name, "coop")[0], _better_baseline(entries, name))
        if lead.mean < -MARGIN:
            below.append(f"{name} {signed(lead)}")
    total = len(entries.names)
    return (
        f"{title}: Coop. is at least the better baseline minus {MARGIN} in "
        f"{total - len(below)} of {total} scenarios"
        + (" (differences with paired standard errors)" if below else "")
        + exceptions(below)
    )


def _compared(table: str, entries: Entries) -> list[str]:
    indiv = entries.pick(learner="indiv")
    far = [
        f"{e.name} ({errors_from(e.measure('reward'), e.result.reference['reward']):+.1f} s.e.)"
        for e in indiv
        if abs(errors_from(e.measure("reward"), e.result.reference["reward"])) > AGREE
    ]
    shown = [entry for entry in entries if entry.paper("reward")]
    same = [e for e in shown if agrees(e.measure("reward"), e.paper("reward"))]
    title = _title(table)
    return [
        as_good_as_baselines(title, entries),
        f"{title}: Indiv. is within {AGREE:g} standard errors of the exact value of shortest-path "
        f"policies in {len(indiv) - len(far)} of {len(indiv)} scenarios{exceptions(far)}",
        f"{title}: the reward agrees with the paper's in {len(same)} of {len(shown)} rows, within "
        f"{AGREE:g} standard errors of the difference.",
    ]
