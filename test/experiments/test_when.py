# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The experiment on when robots should coordinate: points, means over maps, claims, figures."""

import numpy as np
import pandas as pd
import pytest
from made_up_results import made_up, result_of

from sparse_coord_ros.core.game.unseen import split_of
from sparse_coord_ros.core.solve.reference import shortest_path_reference
from sparse_coord_ros.core.solve.shipped import shipped_asking_team
from sparse_coord_ros.studies.catalogue import (
    WHEN,
    WHEN_PAIRS,
    WHEN_TEAMS,
    experiment,
)
from sparse_coord_ros.studies.condition_result import SUMS
from sparse_coord_ros.studies.conditions import make_condition
from sparse_coord_ros.studies.report.charts import BEST_ASKING
from sparse_coord_ros.studies.report.sections import SECTIONS
from sparse_coord_ros.studies.report.when import (
    ALWAYS,
    COOP,
    FACTORED,
    KINDS,
    NEVER,
    interval_name,
    means,
    points,
    tightness,
)
from sparse_coord_ros.studies.report.when_figures import when, when_kinds, when_more
from sparse_coord_ros.studies.runner import run_experiment


def learned(name, learner="factored", *, asks=0.5, returns=None, failed=(), **settings):
    """Return a made-up result with four runs that ask and earn so much."""
    condition = make_condition(name, learner, {**WHEN, "penalty": -100, **settings})
    means_of = {measure: [1.0] * 4 for measure in SUMS}
    means_of["asks"] = [asks] * 4
    if returns is not None:
        means_of["returns"] = [returns] * 4
    not_arrived = [50 if run in failed else 0 for run in range(4)]
    return made_up(condition, means=means_of, not_arrived=not_arrived)


def test_no_building_for_the_test_is_opened():
    generated = [n for n in (*WHEN_PAIRS, *WHEN_TEAMS) if n.startswith("unseen")]
    assert {split_of(name) for name in generated} == {"validation"}
    assert len(experiment("when").conditions) == len(
        {one.id for one in experiment("when").conditions}
    )


def test_a_point():
    """In env1 robots on shortest paths lose 33.86 at -100; 27.96 can be won back."""
    paths = shortest_path_reference(
        make_condition("env1", "coop", {"penalty": -100}).scenario
    )
    result = learned("env1", returns=paths.returns + 14.0, ask_cost=2, failed=(1,))
    point = points([result]).iloc[0]
    assert point["line"] == FACTORED and point["robots"] == 2
    assert point["ratio"] == pytest.approx(33.857 / 2, abs=1e-3)
    assert point["undiscounted"] == pytest.approx(50 * paths.miscoordinations)
    assert point["gap"] == point["relative_gain"] == pytest.approx(27.96 / 2, abs=5e-3)
    assert point["gained"] == pytest.approx(7.0)
    assert (point["failed"], point["teams"], point["half"]) == (1, 4, 1.0)
    assert not point["avoidable"]


def test_questions_are_those_of_teams_that_arrive():
    result = learned("env1", failed=(0,))
    result.means["asks"][:] = [40.0, 1.0, 2.0, 3.0]
    assert points([result]).iloc[0]["questions"] == 2.0
    lost = learned("env1", failed=range(4))
    assert np.isnan(points([lost]).iloc[0]["questions"])


@pytest.mark.parametrize(
    ("result", "line"),
    [
        (learned("isr", "coop"), COOP),
        (learned("isr", "noncoop"), NEVER),
        (learned("isr", perception="probability:0.5"), "50 % of questions answered"),
        (learned("unseen1-rooms-4r-1"), "4 robots"),
        (learned("env1", interactions="swap"), KINDS["swap"]),
        (learned("env1", interactions="block", ask_cost=5), KINDS["block"]),
    ],
    ids=str,
)
def test_lines(result, line):
    assert points([result])["line"].tolist() == [line]


def test_failing_answers_count_twice_in_what_a_gain_is_worth():
    result = learned("env1", perception="probability:0.5")
    point = points([result]).iloc[0]
    assert point["relative_gain"] == pytest.approx(point["gap"] / 4)


def test_a_pair_of_factored_stands_beside_asking_always_and_the_best_asking_team():
    found = points([learned("env1")]).set_index("line")
    team = shipped_asking_team(learned("env1").scenario)
    paths = shortest_path_reference(learned("env1").scenario)
    assert found.loc[BEST_ASKING, "gained"] == pytest.approx(team.value - paths.returns)
    assert 1.0 < found.loc[BEST_ASKING, "questions"] < 3.0
    # About 9 steps, discounted, in each of which a robot asks.
    optimum = found.loc[ALWAYS, "gap"]
    assert optimum - 10.0 < found.loc[ALWAYS, "gained"] < optimum - 7.0


def made_points(rows):
    names = ("scenario", "ratio", "questions", "gained", "gap")
    data = pd.DataFrame(rows, columns=names)
    return data.assign(
        line=FACTORED,
        avoidable=False,
        failed=0,
        teams=4,
        half=1.0,
        relative_gain=data["gap"],
    )


def test_means_pool_gains_in_questions():
    found = means(
        made_points(
            [
                ("a", 12.0, 1.0, 3.0, 10.0),
                ("b", 27.0, 2.0, 9.0, 20.0),
                ("b", 0.5, 0.0, 0.0, 0.4),
                ("c", 0.0, 0.0, 0.0, 0.0),
            ]
        )
    )
    assert found["interval"].map(interval_name).tolist() == ["0.3 to 1", "10 to 30"]
    own = found.iloc[1]
    assert (own["questions"], own["share"]) == (1.5, 0.4)
    assert own["ratio"] == pytest.approx(18.0)
    assert (own["maps"], own["conditions"], own["teams"]) == (2, 2, 8)
    # Of two maps a resample has one twice in half of the cases: 1, 1.5, 1.5 and 2 questions.
    assert own["questions_error"] == pytest.approx(np.sqrt(0.125), abs=0.01)
    assert np.isnan(found.iloc[0]["share_error"]), "one map tells nothing of others"


def test_intervals():
    assert [interval_name(number) for number in (0, 1, 8)] == [
        "< 0.3",
        "0.3 to 1",
        "> 300",
    ]


def test_points_on_one_curve_are_tight():
    places = np.geomspace(1.0, 100.0, 30)
    rows = [(f"map {k % 6}", x, np.log(x), x / 2, x) for k, x in enumerate(places)]
    questions, share = tightness(made_points(rows), "ratio")
    assert questions < 0.15 and share == pytest.approx(0.0, abs=1e-12)
    shifted = [
        (name, x, asks + (name == "map 0"), gained, gap)
        for name, x, asks, gained, gap in rows
    ]
    assert tightness(made_points(shifted), "ratio")[0] > 0.3


def test_points_of_another_kind_are_judged_by_the_curve_of_factored():
    places = np.geomspace(1.0, 100.0, 30)
    rows = [(f"map {k % 6}", x, 1.0, x / 2, x) for k, x in enumerate(places)]
    swaps = made_points([(*row[:2], 1.5, *row[3:]) for row in rows])
    both = pd.concat([made_points(rows), swaps.assign(line=KINDS["swap"])])
    assert tightness(both, "ratio") == pytest.approx((0.0, 0.0))
    assert tightness(both, "ratio", KINDS["swap"]) == pytest.approx((0.5, 0.0))


def test_the_loss_of_a_stop_is_time():
    """Robots that block each other in env1 lose the same at each penalty, and pay nothing."""
    losses = [
        points([learned("env1", interactions="block:anywhere", penalty=penalty)])
        for penalty in (-5, -500)
    ]
    ratios = [own.iloc[0]["ratio"] for own in losses]
    assert ratios[0] == pytest.approx(ratios[1]) and ratios[0] > 1.0
    assert losses[0].iloc[0]["undiscounted"] == 0.0


def some_results():
    """Return made-up results: Factored asks where the ratio is large, Coop. everywhere."""
    found = []
    for penalty in (-5, -100):
        for name in ("env1", "isr", "unseen1-doors-2r-1"):
            asks = 2.0 if name == "env1" and penalty == -100 else 0.0
            best = result_of(name, "factored", {"penalty": penalty}).optimum
            earned = {"penalty": penalty, "returns": best - 0.1}
            for cost in (1, 5):
                found.append(learned(name, asks=asks, ask_cost=cost, **earned))
            swap = {"interactions": "swap", "penalty": penalty}
            found.append(learned(name, asks=1.0, returns=best - 0.1, **swap))
            found.append(learned(name, "coop", asks=1.5, **earned))
            found.append(learned(name, "cq", asks=1.0, **earned))
    return found


def test_the_section():
    section = SECTIONS["when"](some_results())
    needless, beats = section.claims
    assert (needless.holds, needless.cases) == (1, 3)
    assert needless.measured.endswith("Factored 0.00, Coop. 1.50, CQ-learning 1.00")
    assert (beats.holds, beats.cases) == (2, 2)
    table = section.table
    rows = table[(table["line"] == FACTORED) & (table["measure"] == "questions")]
    assert rows["30 to 100"].tolist() == ["2.00 (-)"]
    assert rows["0.3 to 1"].tolist()[0].startswith("0.00 (")
    assert set(table["line"]) >= {FACTORED, COOP, ALWAYS, "pairs with ways apart"}
    assert section.values["maps"] == 3


@pytest.mark.parametrize("draw", [when, when_more, when_kinds])
def test_the_figures(draw):
    upper, lower = draw(some_results()).axes
    assert upper.get_xscale() == lower.get_xscale() == "log"
    said = [text.get_text() for text in upper.texts]
    regions = ["no need to", "ask where it matters", "may always ask"]
    assert said == (regions if draw is when else [])


def test_it_runs():
    """A condition of each kind with few steps."""
    chosen = [
        make_condition(name, learner, {**WHEN, "steps": 200, "penalty": -5, **settings})
        for name, learner, settings in (
            ("env1", "factored", {"ask_cost": 0.2}),
            ("env1", "cq", {}),
            ("isr", "factored", {"perception": "probability:0.2"}),
            ("unseen1-door-4r-1", "factored", {}),
        )
    ]
    found = run_experiment(chosen, runs=2, trials=4, jobs=1, engine="python")
    table = points(list(found.values()))
    assert len(table) == 5, "and the team that always asks in env1"
    assert np.isfinite(table[["ratio", "gained", "gap"]].to_numpy(dtype=float)).all()
