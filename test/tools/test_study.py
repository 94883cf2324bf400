# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The protocol study: its loss, its search, its document; with made-up results."""

import csv
from types import SimpleNamespace

import pytest

from sparse_coord_ros.experiments.catalogue import LARGE, SMALL
from sparse_coord_ros.experiments.store import Plan
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.evaluation import Measure
from sparse_coord_ros.learn.learners import learner_of
from tools.study.__main__ import main
from tools.study.document import protocol_document
from tools.study.factored import COOPS, FACTORED, JUDGED, SHIPPED, best_known
from tools.study.search import (
    COOP,
    EARLIER,
    FINALISTS,
    SETTINGS,
    SPACE,
    STARTS,
    TEXTBOOK,
    Judgement,
    final,
    judge,
    search,
    settings_of,
    vary,
)

NO_LIMIT = float("inf")


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
    outcome = judge(TEXTBOOK, good, NO_LIMIT)
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

    assert judge(TEXTBOOK, compute, NO_LIMIT).loss == pytest.approx(loss, abs=1e-9)


def test_every_choice_is_a_setting():
    for name, values in SPACE.items():
        for value in values:
            load_scenario("env1").with_settings(settings_of({**TEXTBOOK, name: value}))
    assert set(settings_of(TEXTBOOK)) == set(SETTINGS)
    assert set(TEXTBOOK) == set(SPACE)
    for start in STARTS.values():
        assert all(start[name] in values for name, values in SPACE.items())


def likes(wanted):
    """Return results that are the better the more choices are the wanted ones."""

    def compute(cell):
        own, ideal = cell.scenario, cell.scenario.with_settings(settings_of(wanted))
        wrong = sum(str(getattr(own, n)) != str(getattr(ideal, n)) for n in SETTINGS)
        return result(good(cell).measure("reward").mean - wrong)

    return compute


def test_the_search_is_its_seed_s_and_tries_no_protocol_twice():
    wanted = {**TEXTBOOK, "epsilon_first": 0.2, "max_steps": 100, "q_star_init": 20}
    tried = [[dict(one.choices) for one in search(likes(wanted), 30, seed)] for seed in (3, 3, 4)]
    assert tried[0] == tried[1] != tried[2]
    assert tried[0][: len(STARTS)] == list(STARTS.values())
    assert len({tuple(one.values()) for one in tried[0]}) == 30


def test_the_final_judges_the_best_again():
    compute = likes({**TEXTBOOK, "max_steps": 100})
    outcomes = list(search(compute, 30))
    finalists = list(final(outcomes, likes({**TEXTBOOK, "max_steps": 50})))
    assert len(finalists) == FINALISTS
    losses = {tuple(one.choices.values()): one.loss for one in outcomes if one.whole}
    chosen = [losses[tuple(one.choices.values())] for one in finalists]
    assert chosen == sorted(losses.values())[:FINALISTS]
    assert [one.loss for one in finalists] != chosen
    assert all(one.whole for one in finalists)


def test_every_choice_is_varied_alone_and_a_hopeless_change_is_left():
    def compute(cell):
        return result(0.0, failed=10) if cell.scenario.goal_value == 0 else good(cell)

    best = judge(TEXTBOOK, compute, NO_LIMIT)
    variations = list(vary(best, compute))
    assert len(variations) == sum(map(len, SPACE.values())) - len(SPACE)
    for name, value, outcome in variations:
        changed = {key for key in SPACE if outcome.choices[key] != TEXTBOOK[key]}
        assert (changed, outcome.choices[name]) == ({name}, value)
        assert outcome.whole == (name != "goal_value")


def test_the_document():
    compute = likes({**TEXTBOOK, "q_star_init": 20})
    outcomes = list(search(compute, 12))
    finalists = list(final(outcomes, compute))
    best = min(finalists, key=lambda one: one.loss)

    def written():
        return protocol_document(
            COOP,
            Plan(7, 40, 100),
            Plan(9, 120, 100),
            outcomes,
            finalists,
            best,
            list(vary(best, compute)),
        )

    text = written()
    assert "40 learning runs" in text
    assert "120 runs and seeds from 9" in text
    found = best.choices["q_star_init"]
    values = ", ".join(f"{value:g}" for value in SPACE["q_star_init"])
    starts = " | ".join(f"{start['q_star_init']:g}" for start in STARTS.values())
    assert f"| q_star_init | {values} | {starts} | **{found:g}** |" in text
    assert "It is not the default" in text
    finalists[:] = [Judgement(EARLIER)]
    assert "It is the default of every scenario" in written()


def test_the_defaults_are_a_protocol_of_the_space():
    """The shipped protocol is one that the search can find."""
    scenario = load_scenario("env1")
    kind, numbers = scenario.step_size.kind, scenario.step_size.numbers
    assert kind == "floored"
    starts = scenario.starts.numbers
    assert (scenario.starts.kind, starts[0]) == ("exploring", 1)
    choices = dict(
        zip(
            SPACE,
            (*numbers, *scenario.epsilon.numbers, *starts[1:], scenario.q_star_init)
            + (scenario.q_coord_init, scenario.goal_value, scenario.max_steps),
            strict=True,
        )
    )
    assert [name for name in SPACE if choices[name] not in SPACE[name]] == []


@pytest.mark.long
def test_the_command(tmp_path, capsys, monkeypatch):
    # In place: others have imported these very objects.
    for name, value in TEXTBOOK.items():
        monkeypatch.setitem(SPACE, name, (1000, 200) if name == "max_steps" else (value,))
    for name in set(STARTS) - {"the textbook protocol"}:
        monkeypatch.delitem(STARTS, name)
    arguments = ["--runs", "2", "--trials", "5", "--candidates", "2"]
    out = str(tmp_path / "s")
    assert main([*arguments, "--out", out]) == 0
    assert "step_size: floored:0.6:0:0" in capsys.readouterr().out
    text = (tmp_path / "s/protocol.md").read_text()
    assert text.startswith("# The learning protocol")
    assert "| choice | values | the textbook protocol | found |" in text
    assert "| max_steps | 1000, 200 | 1000 | **" in text
    assert "| exponent | 0.6 | 0.6 | **0.6** |" in text
    with (tmp_path / "s/protocols.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["max_steps"] for row in rows] == ["1000", "200"]
    for row in rows:
        assert {n: float(row[n]) for n in TEXTBOOK if n != "max_steps"} == {
            n: float(value) for n, value in TEXTBOOK.items() if n != "max_steps"
        }
    assert main([*arguments, "--out", out, "--seed", "1"]) == 2
    assert "seed" in capsys.readouterr().err


def test_the_factored_learner_s_own_search(monkeypatch):
    """Its defaults come first; what is missing to the class bound adds up."""
    assert settings_of(SHIPPED) | dict(learner_of("factored").defaults) == {
        **settings_of(SHIPPED),
        "peers": "all",
    }
    for name, values in FACTORED.space.items():
        assert SHIPPED[name] in values
        for value in values:
            load_scenario("env1").with_settings(settings_of({**SHIPPED, name: value}))

    def short(cell, by=0.5, failed=0):
        assert cell.learner == "factored"
        return SimpleNamespace(
            best=lambda name: Measure(best_known(cell, SimpleNamespace(optimum=9.0)) - by, 1, 0.1),
            optimum=9.0,
            failed_teams=failed,
            runs=10,
        )

    outcome = FACTORED.judge(SHIPPED, short, NO_LIMIT)
    assert (outcome.whole, outcome.loss) == (True, pytest.approx(0.5 * len(JUDGED)))
    stopped = FACTORED.judge(SHIPPED, lambda cell: short(cell, failed=1), 20.0)
    assert (stopped.whole, len(stopped.difference)) == (False, 2)
    outcomes = list(search(short, 7, task=FACTORED))
    assert [one.choices for one in outcomes[:2]] == [SHIPPED, COOPS]
    text = protocol_document(
        FACTORED, Plan(7, 40, 100), Plan(9, 120, 100), outcomes, outcomes, outcomes[0], []
    )
    assert "It is the default of the learner factored" in text
    assert "| 0 | the learner's defaults | 5.00 | 0.50 |" in text
    assert "--learner factored --candidates 7" in text
