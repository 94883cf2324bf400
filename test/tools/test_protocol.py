# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The search for a protocol: its loss, its choices, its texts; with made-up results."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from sparse_coord_ros.experiments.catalogue import LARGE, SMALL
from sparse_coord_ros.experiments.store import Plan
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.evaluation import Measure
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.solve.shipped import shipped_class_bound
from tools.study import __main__ as tool
from tools.study.protocol import COOP, FACTORED, FINALISTS, JUDGED, SETTINGS, settings_of

TEXTBOOK, EARLIER = COOP.starts.values()


def result(reward=100.0, *, asks=0.0, failed=0, runs=10):
    """Return what stands in for a cell's result: optimum 110, shortest paths 100."""
    means = {"reward": reward, "asks": asks}
    return SimpleNamespace(
        measure=lambda name: Measure(means[name], 1.0, 0.1),
        optimum=110.0,
        reference={"reward": 100.0},
        failed_teams=failed,
        runs=runs,
    )


def good(cell):
    """Coop. closes 90 % of the gap at -100 and is worth the shortest paths at -20."""
    if cell.scenario.penalty == -100:
        return result(90.0 if cell.learner == "noncoop" else 108.0)
    return result()


def test_nothing_is_missed():
    outcome = COOP.judge(TEXTBOOK, good)
    assert (outcome.loss, outcome.whole) == (0.0, True)
    assert outcome.closed == dict.fromkeys(("env1", "env2-2r", "pentagon"), pytest.approx(0.9))
    assert set(outcome.difference) == set(SMALL + LARGE)
    assert set(outcome.asks) == {"isr", "mit", "cit", "suny"}
    assert (outcome.failed_teams, outcome.teams) == (0, 120)


@pytest.mark.parametrize(
    ("name", "penalty", "changed", "loss"),
    [
        ("env1", -100, {"reward": 90.0 + 20 * 0.72}, 40 * 0.1),
        ("pentagon", -100, {"reward": 90.0 + 20 * 0.42}, 40 * 0.1),
        ("env2-4r", -20, {"reward": 98.7}, 2.0),
        ("cmu", -20, {"reward": 99.7}, 0.0),
        ("cmu", -20, {"failed": 1}, 10.0),
        ("mit", -20, {"asks": 0.13}, 2.0),
        ("cmu", -20, {"asks": 0.13}, 0.0),
    ],
)
def test_what_is_missed_adds_up(name, penalty, changed, loss):
    def compute(cell):
        one = cell.name == name and cell.learner == "coop" and cell.scenario.penalty == penalty
        return result(**changed) if one else good(cell)

    assert COOP.judge(TEXTBOOK, compute).loss == pytest.approx(loss, abs=1e-9)


@pytest.mark.parametrize("search", [COOP, FACTORED], ids=lambda one: one.name)
def test_every_choice_is_a_setting(search):
    for start in search.starts.values():
        assert set(settings_of(start)) <= set(SETTINGS)
        for name, (values, *_) in search.choices.items():
            assert start[name] in values
            for value in values:
                load_scenario("env1").with_settings(settings_of({**start, name: value}))


def likes(wanted):
    """Return results that are the better the more choices are the wanted ones."""

    def compute(cell):
        own, ideal = cell.scenario, cell.scenario.with_settings(settings_of(wanted))
        wrong = sum(str(getattr(own, n)) != str(getattr(ideal, n)) for n in SETTINGS)
        return result(good(cell).measure("reward").mean - wrong)

    return compute


def test_the_search_is_its_seed_s_and_tries_no_protocol_twice():
    wanted = {**TEXTBOOK, "epsilon_first": 0.2, "max_steps": 100, "q_star_init": 20}
    tried = [
        [dict(one.choices) for one in replace(COOP, candidates=30).search(likes(wanted), seed)]
        for seed in (3, 3, 4)
    ]
    assert tried[0] == tried[1] != tried[2]
    assert tried[0][:2] == [TEXTBOOK, EARLIER]
    assert len({tuple(one.values()) for one in tried[0]}) == 30


def test_the_final_judges_the_best_again():
    compute = likes({**TEXTBOOK, "max_steps": 100})
    outcomes = list(replace(COOP, candidates=30).search(compute))
    finalists = COOP.final(outcomes, likes({**TEXTBOOK, "max_steps": 50}))
    assert len(finalists) == FINALISTS
    losses = {tuple(one.choices.values()): one.loss for one in outcomes if one.whole}
    before = [losses[tuple(one.choices.values())] for one in finalists]
    assert sorted(before) == sorted(losses.values())[:FINALISTS]
    after = [one.loss for one in finalists]
    assert after == sorted(after) != before
    assert all(one.whole for one in finalists)


def test_every_choice_is_varied_alone_and_a_hopeless_change_is_left():
    def compute(cell):
        return result(0.0, failed=10) if cell.scenario.goal_value == 0 else good(cell)

    best = COOP.judge(TEXTBOOK, compute)
    variations = list(COOP.vary(best, compute))
    assert len(variations) == sum(len(values) - 1 for values, *_ in COOP.choices.values())
    for name, value, outcome in variations:
        changed = {key for key in TEXTBOOK if outcome.choices[key] != TEXTBOOK[key]}
        assert (changed, outcome.choices[name]) == ({name}, value)
        assert outcome.whole == (name != "goal_value")


def test_the_texts():
    asked = set()

    def compute(cell, plan):
        asked.add(plan)
        return likes(TEXTBOOK)(cell)

    few = replace(COOP, candidates=12)
    texts = few.texts(compute)
    assert asked == {Plan(10_000, 100, 100), Plan(1_010_000, 300, 100)}
    found = texts["coop, found"]
    assert found.startswith("12 protocols were tried, ")
    assert "100 learning runs of 100 trials in each scenario and seeds from 10000" in found
    assert "300 runs and seeds from 1010000" in found
    assert "\n```yaml\nstep_size: floored:" in found
    first, second = (f"{start['q_coord_init']:g}" for start in (TEXTBOOK, EARLIER))
    head = "| choice | values | the textbook protocol | the best of earlier searches | found |"
    assert texts["coop, choices"].startswith(head)
    assert f"| q_coord_init | 0, 100, 200 | {first} | {second} | **" in texts["coop, choices"]
    assert "| 0 | the textbook protocol | " in texts["coop, search"]
    assert texts["coop, final"].count("\n") == 2 + FINALISTS
    assert texts["coop, final"].splitlines()[2].startswith("| - | ")
    assert texts["coop, one choice"].startswith("Without a change: ")
    assert texts["coop, one choice"].count("\n| ") == 2 + len(COOP.choices)
    assert "It is not the default:" in found
    alone = replace(few, candidates=2).texts(lambda cell, plan: likes(EARLIER)(cell))
    assert "It is the default:" in alone["coop, found"]
    assert "\n| 1 | exponent 0.5, floor_first 0.1, " in alone["coop, search"]  # it is better


def test_the_defaults_are_a_protocol_of_the_space():
    """The shipped protocol is one that the search can find."""
    scenario = load_scenario("env1")
    kind, numbers = scenario.step_size.kind, scenario.step_size.numbers
    assert kind == "floored"
    starts = scenario.starts.numbers
    assert (scenario.starts.kind, starts[0]) == ("exploring", 1)
    choices = dict(
        zip(
            COOP.choices,
            (*numbers, *scenario.epsilon.numbers, *starts[1:], scenario.q_star_init)
            + (scenario.q_coord_init, scenario.goal_value, scenario.max_steps),
            strict=True,
        )
    )
    assert [
        name for name, (values, *_) in COOP.choices.items() if choices[name] not in values
    ] == []


@pytest.mark.long
def test_the_command(tmp_path, capsys, monkeypatch):
    one_value = {name: ((value,), value, value) for name, value in TEXTBOOK.items()}
    choices = {**one_value, "max_steps": ((1000, 200), 1000, 200)}
    small = replace(COOP, choices=choices, candidates=2, plan=Plan(1, 2, 5))
    monkeypatch.setitem(tool.STUDIES, "protocol-coop", small)
    page = (tool.DOCS / small.page).read_text(encoding="utf-8")
    monkeypatch.setattr(tool, "DOCS", tmp_path)
    (tmp_path / small.page).write_text(page, encoding="utf-8")
    assert tool.main(["protocol-coop", "--out", str(tmp_path / "s")]) == 0
    assert "step_size: floored:0.6:0:0" in capsys.readouterr().out
    text = (tmp_path / small.page).read_text(encoding="utf-8")
    assert "2 protocols were tried, " in text
    assert "| max_steps | 1000, 200 | 1000 | 200 | **" in text
    assert "| exponent | 0.6 | 0.6 | 0.6 | **0.6** |" in text


def test_the_factored_learner_s_own_search():
    """Its defaults come first; what is missing to the class bound adds up."""
    shipped, coops = FACTORED.starts.values()
    assert settings_of(shipped) | dict(learner_of("factored").defaults) == {
        **settings_of(shipped),
        "peers": "all",
    }
    assert {coops[name] == EARLIER[name] for name in coops} == {True}

    def short(cell, by=0.5, failed=0):
        assert cell.learner == "factored"
        bound = shipped_class_bound(cell.scenario)
        best = 9.0 if bound is None else bound.value
        return SimpleNamespace(
            best=lambda name: Measure(best - by, 1, 0.1),
            optimum=9.0,
            failed_teams=failed,
            runs=10,
        )

    outcome = FACTORED.judge(shipped, short)
    assert (outcome.whole, outcome.loss) == (True, pytest.approx(0.5 * len(JUDGED)))
    stopped = FACTORED.judge(shipped, lambda cell: short(cell, failed=1), 20.0)
    assert (stopped.whole, len(stopped.difference)) == (False, 2)
    texts = replace(FACTORED, candidates=7).texts(lambda cell, plan: short(cell))
    assert "It is the default:" in texts["factored, found"]
    assert "| 0 | the learner's defaults | 5.00 | 0.50 |" in texts["factored, search"]
