# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord settings`: what the tables that validate say."""

import json

from sparse_coord_ros.core.game.scenario import DIALOGUE_SETTINGS, PROTOCOL, SETTINGS
from sparse_coord_ros.core.learners.registry import LEARNERS
from sparse_coord_ros.core.runs.run_config import RUN_SETTINGS


def test_every_setting_is_there_once(sparse_coord):
    code, out, err = sparse_coord("settings", "--json")
    assert (code, err) == (0, "")
    groups = json.loads(out)
    told = [
        name
        for group in ("scenario", "questions", "protocol")
        for name in groups[group]
    ]
    assert sorted(told) == sorted(SETTINGS)
    assert {*DIALOGUE_SETTINGS, *PROTOCOL} <= {*SETTINGS}
    assert list(groups["run"]) == list(RUN_SETTINGS)
    assert list(groups["learners"])[: len(LEARNERS.registered)] == list(
        LEARNERS.registered
    )
    nodes = (
        "world_simulator",
        "robot",
        "recorder",
        "driver",
        "body",
        "player",
        "watch",
    )
    assert {"drive", *nodes} <= set(groups)


def test_it_says_what_validates(sparse_coord):
    said = json.loads(sparse_coord("settings", "discount", "starts", "--json")[1])
    assert list(said) == ["scenario", "protocol"]
    one = said["scenario"]["discount"]
    assert (one["default"], one["low"], one["high"]) == (0.95, 0, 0.999)
    assert one["allowed"] == SETTINGS["discount"].allowed
    forms = {form["form"]: form for form in said["protocol"]["starts"]["forms"]}
    assert list(forms) == SETTINGS["starts"].allowed.split(", ")
    assert forms["mixed:P_RANDOM"]["numbers"] == [
        {"name": "p_random", "low": 0, "high": 1, "repeated": False}
    ]


def test_forms_say_what_they_mean(sparse_coord):
    words = " ".join(sparse_coord("settings", *SETTINGS)[1].split())
    kinds = [one.kind for one in SETTINGS.values() if not isinstance(one.kind, type)]
    forms = [form for kind in kinds for form in kind.forms]
    assert [form.text for form in forms if not form.meaning] == []
    assert [
        form.text for form in forms if f"{form.text}: {form.meaning}" not in words
    ] == []


def test_a_learner_and_its_own_defaults(sparse_coord):
    out = sparse_coord("settings", "voi")[1]
    assert "epsilon=linear:0.3:0.02:0.8" in out
    assert "coop" not in out
