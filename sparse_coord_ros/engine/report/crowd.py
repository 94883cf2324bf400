# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""More robots: one random peer perceived, or all of them (footnote 3 of the paper)."""

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from sparse_coord_ros.engine.report.analysis import difference, loss_alone
from sparse_coord_ros.engine.report.entries import Entries
from sparse_coord_ros.engine.report.figures import (
    COLOURS,
    LABELS,
    MARKERS,
    Curve,
    Panel,
    canvas,
    legend,
)
from sparse_coord_ros.engine.report.section import Picture, Section, names_and_settings
from sparse_coord_ros.engine.report.sweeps import HEAD, YARDSTICKS
from sparse_coord_ros.engine.report.tables import (
    NOTHING,
    Table,
    dense_bytes,
    optimum,
    percent,
    signed,
    size,
    with_error,
)

PEERS = {"one": "Coop., one peer", "all": "Coop., all peers"}


def crowd_section(name: str, entries: Entries) -> Section:
    """Return what more robots do, with one random peer and with all of them perceived."""
    groups = {
        "Non-coop.": entries.pick(learner="noncoop"),
        **{label: _peers(entries, peers) for peers, label in PEERS.items()},
    }
    rows = []
    for entry in entries:
        coop = entry.cell.learner == "coop"
        rows.append(
            [
                str(entry.result.robots),
                PEERS[entry.scenario.peers] if coop else entry.learner,
                with_error(entry.measure("reward")),
                f"{loss_alone(entry).mean:.2f}",
                optimum(entry),
                with_error(entry.measure("miscoordinations"), 3),
                with_error(entry.measure("asks"), 3) if coop else NOTHING,
                percent(entry.result.arrived, 2),
                size(entry.result.visited_bytes) if coop else NOTHING,
                size(dense_bytes(entry)) if coop else NOTHING,
            ]
        )
    curves = {
        label: Curve(label, learner, [e.result.robots for e in own], own, label == PEERS["all"])
        for (label, own), learner in zip(groups.items(), ("noncoop", "coop", "coop"), strict=True)
    }
    one, every = groups[PEERS["one"]], groups[PEERS["all"]]
    largest = every[-1]
    return Section(
        "Several robots cross between two rooms. With one peer, COORDINATE perceives one other "
        "robot drawn at random, as in the paper's four-robot scenario; with all peers (footnote 3 "
        "of the paper) Q^C is over the states of all robots, and only visited rows are kept.",
        [
            Table(
                f"Team size against reward, use of COORDINATE and memory "
                f"({names_and_settings(entries)}). Loss: by how much the reward falls short of "
                "that of robots each alone on the map, which never miscoordinate, wait or ask; "
                "the paths differ in length between the team sizes, so rewards of different "
                "sizes compare by their losses only (same standard errors). Bytes are per robot: "
                "of the visited rows of Q^C (with their keys where it is sparse), and of a dense "
                "table.",
                [
                    "robots",
                    "learner, peers",
                    HEAD[0],
                    "loss",
                    *HEAD[1:],
                    "all arrive",
                    "bytes visited",
                    "bytes dense",
                ],
                rows,
            )
        ],
        [
            Picture(
                name,
                f"Reward, loss against robots alone on the map (bound less reward), asks and "
                f"memory against the number of robots. {YARDSTICKS}",
                _figure(
                    list(curves.values()),
                    {
                        "one peer, visited": (one, False),
                        "one peer, dense": (one, True),
                        "all peers, visited": (every, False),
                        "all peers, dense": (every, True),
                    },
                ),
            )
        ],
        [
            f"With {largest.result.robots} robots a dense Q^C over all of them would need "
            f"{size(dense_bytes(largest))} a robot; its visited rows take "
            f"{size(largest.result.visited_bytes)}."
        ],
        [
            "Coop. less Non-coop. with one peer and with all peers (paired standard errors): "
            + "; ".join(
                f"{base.result.robots} robots {signed(difference(a, base))} and "
                f"{signed(difference(b, base))}"
                for base, a, b in zip(groups["Non-coop."], one, every, strict=True)
            )
            + "."
        ],
    )


def _peers(entries: Entries, peers: str) -> Entries:
    return entries.pick(learner="coop", test=lambda entry: entry.scenario.peers == peers)


def _figure(curves: Sequence[Curve], memory: Mapping[str, tuple[Entries, bool]]) -> Figure:
    """Draw reward, loss, asks and memory against the number of robots.

    Args:
        curves: the learners.
        memory: label -> cells, and whether a dense Q^C is meant instead of its visited rows.
    """
    robots = list(curves[0].xs)
    figure, grid = canvas(2, 2, 4.6, 3.2)
    panel = Panel("", "robots", curves, {x: f"{x:g}" for x in robots})
    for axes, measure in zip(grid.flat, ("reward", "loss", "asks"), strict=False):
        panel.draw(axes, measure)
        axes.set(xlabel=panel.xlabel, ylabel=LABELS[measure])
    axes = grid[1][1]
    for label, (entries, dense) in memory.items():
        own = [dense_bytes(e) if dense else e.result.visited_bytes for e in entries]
        axes.plot(
            [entry.result.robots for entry in entries],
            [float(count) for count in own],
            color="black" if dense else COLOURS["coop"],
            linestyle="--" if label.startswith("all") else "-",
            marker="x" if dense else MARKERS["coop"],
            markerfacecolor="white" if label.startswith("all") else None,
            label=f"Q^C, {label}",
        )
    axes.set(xlabel="robots", ylabel="Q^C of one robot [bytes]", yscale="log")
    axes.set_xticks(robots)
    axes.grid(alpha=0.3)
    legend(figure, grid)
    return figure
