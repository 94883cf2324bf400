# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where in the map COORDINATE is chosen: the paper's central claim."""

import math

from sparse_coord_ros.engine.report.analysis import NEAR, asked_near, near_doorways, time_near
from sparse_coord_ros.engine.report.entries import Entries
from sparse_coord_ros.engine.report.maps import asked_maps
from sparse_coord_ros.engine.report.section import Picture, Section, game
from sparse_coord_ros.engine.report.tables import Table, listed, percent, with_error


def where_section(name: str, entries: Entries) -> Section:
    """Return the maps of asks and the share of asks near doorways."""
    rows, near, never = [], [], []
    for entry in entries:
        share = asked_near(entry)
        if math.isnan(share):
            never.append(entry.name)
        else:
            near.append((entry.name, share, time_near(entry)))
        rows.append(
            [
                entry.name,
                with_error(entry.measure("asks"), 3),
                percent(share),
                percent(time_near(entry)),
                percent(float(near_doorways(entry.scenario.map).mean())),
                percent(entry.result.visited_share),
            ]
        )
    shares = listed([f"{name} {percent(share)} ({percent(time)})" for name, share, time in near])
    everywhere = percent(1.0)
    apart = [(share, time) for _, share, time in near if percent(time) != everywhere]
    more = sum(share > time for share, time in apart)
    rarely = f" Never chosen in: {listed(never)}." if never else ""
    return Section(
        "The paper's central claim is that robots learn to coordinate only where they must. The "
        "maps show in which cells the learned policies choose COORDINATE. S and G are starts and "
        "goals with the robots' numbers; doorways are framed.",
        [
            Table(
                f"Choices of COORDINATE per robot and episode, and the share of them made at most "
                f"{NEAR} moves from a doorway, beside the share of their steps that the robots "
                "take there (until they arrive; as large for robots that ask anywhere alike) and "
                f"the share of all cells that lie there ({game(entries[0])}). Visited: joint "
                "states that a robot's Q^C has updated.",
                [
                    "scenario",
                    "COORDINATE (s.e.)",
                    "asked near",
                    "time near",
                    "cells near",
                    "visited",
                ],
                rows,
                left=1,
            )
        ],
        [
            Picture(
                name,
                f"How often COORDINATE is chosen in each cell, per episode, summed over the "
                f"robots ({game(entries[0])}); a title states the choices per robot and episode.",
                asked_maps(entries),
            )
        ],
        findings=[
            f"Share of COORDINATE chosen at most {NEAR} moves from a doorway, and in parentheses "
            f"the share of the robots' steps taken there ({game(entries[0])}): {shares}. "
            "It is chosen near doorways more often than the time spent there explains in "
            f"{more} of the {len(apart)} scenarios where it is chosen and not every step is near "
            f"a doorway.{rarely}"
        ],
    )
