# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's Tables 1 to 3: ours, the paper's, the exact values."""

from sparse_coord_ros.engine.report.analysis import (
    AGREE,
    agrees,
    errors_from,
)
from sparse_coord_ros.engine.report.entries import Entries, Entry
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
    size,
)

MARGIN = 0.5
"""By how much Coop. may stay below the better baseline and still count as at least as good."""

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
    failed = sum(entry.result.failed_teams for entry in entries)
    teams = sum(entry.result.runs for entry in entries)
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
            f"{_title(name)}: in {failed} of {teams} teams some robot fails to arrive.",
        ],
        misses(entries),
    )


def _silent(coop: Entries) -> list[str]:
    silent = [entry for entry in coop if entry.measure("asks").mean < RARE]
    idle = [e.name for e in silent if e.result.optimum - e.result.reference["reward"] < MARGIN]
    other = [entry.name for entry in silent if entry.name not in idle]
    rare = f"Coop. chooses COORDINATE less than {RARE} times per robot and episode"
    text = []
    if idle:
        text.append(
            f"In {listed(idle)} {rare}, and there is nothing to coordinate: shortest-path "
            f"policies come within {MARGIN} of the joint optimum."
        )
    if other:
        text.append(
            f"In {listed(other)} {rare}, although the joint optimum is higher. A robot that asks "
            "pays the cost and the delay alone, while all robots gain from a miscoordination "
            "avoided; where its own share of the gain is less, independent learners settle on not "
            "asking."
        )
    return text


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


def _compared(table: str, entries: Entries) -> list[str]:
    below = []
    for name in entries.names:
        coop = entries.pick(name, "coop")[0].measure("reward").mean
        best = _better_baseline(entries, name).measure("reward").mean
        if coop < best - MARGIN:
            below.append(f"{name} ({coop - best:+.2f})")
    total = len(entries.names)
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
        f"{title}: Coop. is at least the better baseline minus {MARGIN} in "
        f"{total - len(below)} of "
        f"{total} scenarios{exceptions(below)}",
        f"{title}: Indiv. is within {AGREE:g} standard errors of the exact value of shortest-path "
        f"policies in {len(indiv) - len(far)} of {len(indiv)} scenarios{exceptions(far)}",
        f"{title}: the reward agrees with the paper's in {len(same)} of {len(shown)} rows, within "
        f"{AGREE:g} standard errors of the difference.",
    ]
