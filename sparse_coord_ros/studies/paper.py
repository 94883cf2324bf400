# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of the paper's tables (`paper.yaml`)."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from sparse_coord_ros.core.game.scenario import (
    WHILE_LEARNING,
    Scenario,
    load_scenario,
)
from sparse_coord_ros.core.solve.shipped import game_digest

PAPER_MEASURES = ("returns", "time_to_goal", "miscoordinations")
"""What the paper's tables show."""


PENALTY = -20
"""r^C of the paper's Tables 1 to 3; ours is larger, so that asking pays."""


@cache
def paper_rows() -> Mapping[str, Mapping[str, Any]]:
    """Return the paper's numbers: scenario -> learner -> measure -> [mean, spread]."""
    text = Path(__file__).with_name("paper.yaml").read_text(encoding="utf-8")
    rows: dict[str, dict[str, Any]] = yaml.safe_load(text)
    return rows


def paper_row(scenario: Scenario, learner: str) -> Mapping[str, Any]:
    """Return the paper's numbers for a learner in a scenario: measure -> [mean, spread].

    There are none if the game is not the paper's, or if robots learn from more than answers.
    """
    row: Mapping[str, Any] = paper_rows().get(scenario.name, {}).get(learner, {})
    if not row or scenario.peers_seen == WHILE_LEARNING:
        return {}
    papers = load_scenario(scenario.name, penalty=PENALTY)
    same_game = game_digest(scenario) == game_digest(papers)
    return row if same_game and scenario.horizon == papers.horizon else {}
