# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The record of results: means, errors and spreads, by trial and by run, and what is shown."""

import math
import statistics
from dataclasses import replace

import numpy as np
import pytest

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.runs.measures import EXACT, TRIAL, TRIALS, Measures, by_run

MEANS = [1.0, 2.0, 6.0]
ROBOTS = np.array([[mean - 1, mean + 1] for mean in MEANS])


def of_trials(robots, arrived=None):
    """Return trials of two robots in which every measure of a robot has these values."""
    count = len(robots)
    return Measures(
        source=TRIALS,
        unit=TRIAL,
        trials=count,
        returns=robots,
        time_to_goal=robots,
        miscoordinations=robots.mean(axis=1),
        asks=robots,
        arrived=np.ones(count, dtype=bool) if arrived is None else arrived,
        asked=np.full((2, 3), 0.5),
        stays=np.full((2, 3), count),
    )


def computed(value, variance=4.0):
    """Return an exact evaluation whose measures have this mean and variance."""
    found = of_trials(np.full((1, 2), value), np.array([0.9995]))
    names = ("returns", "time_to_goal", "miscoordinations", "asks", "arrived")
    variances = {name: np.array([variance]) for name in names}
    return replace(found, source=EXACT, trials=0, variances=variances)


def test_of_trials_each_is_a_sample():
    """The robots of a trial depend on each other: their mean is one sample."""
    found = of_trials(ROBOTS)
    error = statistics.stdev(MEANS) / math.sqrt(3)
    for name in ("returns", "time_to_goal", "miscoordinations", "asks"):
        assert found.mean(name) == 3.0
        assert found.error(name) == pytest.approx(error, rel=1e-12)
    assert found.spread("returns") == pytest.approx(statistics.pstdev(ROBOTS.ravel()))
    assert found.spread("miscoordinations") == pytest.approx(statistics.pstdev(MEANS))


def test_of_runs_each_team_is_a_sample():
    """The spread is that of all robots, trials and runs."""
    teams = [of_trials(ROBOTS), of_trials(ROBOTS + 4), of_trials(ROBOTS - 1)]
    found = by_run(teams)
    runs = [3.0, 7.0, 2.0]
    assert found.each("returns").tolist() == runs
    assert found.mean("returns") == pytest.approx(4.0)
    assert found.error("asks") == pytest.approx(statistics.stdev(runs) / math.sqrt(3))
    every = np.concatenate([team.returns for team in teams])
    assert found.spread("returns") == pytest.approx(every.std())
    assert found.by_robot()["returns"] == pytest.approx([3.0, 5.0])
    assert found.stays.tolist() == [[3.0] * 3] * 2
    assert (len(found), found.trials, found.how) == (3, 3, "3 runs, 3 trials")


def test_runs_may_be_joined_in_any_parts():
    teams = [of_trials(ROBOTS + shift) for shift in (0, 1, 2)]
    whole = by_run(teams)
    parts = by_run([by_run(teams[:2]), by_run(teams[2:])])
    assert parts.to_dict() == pytest.approx(whole.to_dict())
    assert parts.stays.tolist() == whole.stays.tolist()


def test_what_is_exact_has_no_error_but_teams_differ():
    one = computed(7.0)
    assert (one.mean("returns"), one.error("returns"), one.spread("returns")) == (
        7,
        0,
        2,
    )
    found = by_run([one, computed(9.0)])
    assert found.mean("asks") == 8.0
    assert found.error("asks") == pytest.approx(1.0)
    assert found.spread("asks") == pytest.approx(math.sqrt(4 + 1))
    assert found.how == "2 runs, exact"


def test_an_unknown_spread_is_no_number():
    assert math.isnan(replace(computed(7.0), variances={}).spread("returns"))


def test_a_single_sample_has_no_error():
    assert math.isnan(of_trials(ROBOTS[:1]).error("returns"))
    assert math.isnan(by_run([computed(7.0)]).error("returns"))


@pytest.mark.parametrize(
    ("trials", "missed", "failed"),
    [
        (1000, 0, False),
        (1000, 1, False),
        (1000, 2, True),
        (500, 1, True),
        (3000, 3, False),
        (7000, 7, False),
        (7000, 8, True),
    ],
)
def test_a_failed_team_misses_more_than_one_trial_of_a_thousand(trials, missed, failed):
    arrived = np.arange(trials) >= missed
    assert of_trials(np.zeros((trials, 2)), arrived).failed == failed


def test_failed_teams_of_runs_are_counted():
    arrived = [np.ones(1000, dtype=bool) for _ in range(4)]
    arrived[1][:1] = False
    arrived[2][:2] = False
    found = by_run(of_trials(np.zeros((1000, 2)), one) for one in arrived)
    assert found.failed == 1


def test_trials_that_exceed_the_optimum_say_by_how_many_errors():
    found = of_trials(ROBOTS)
    error = found.error("returns")
    assert found.errors_above(3.0 - 2 * error) == pytest.approx(2.0)
    assert found.errors_above(3.5) == 0.0
    assert found.cells(optimum=3.0 - 2 * error)["return"] == (
        f"3.00 ± {error:.2f}, 2.0 s.e. above the optimum"
    )
    assert found.cells(optimum=3.5)["return"] == f"3.00 ± {error:.2f}"
    single = of_trials(ROBOTS[:1])
    assert single.cells(optimum=0.5)["return"] == "1.00 ± -, above the optimum"
    rounding = computed(3.0 + 1e-9)
    assert rounding.cells(optimum=3.0)["return"] == "3.00"


def test_cells_have_errors_and_the_source():
    arrived = np.array([True, False, True])
    cells = of_trials(ROBOTS, arrived).cells()
    assert cells == {
        "return": "3.00 ± 1.53",
        "time to goal": "3.00 ± 1.53",
        "miscoordinations": "3.00 ± 1.53",
        "asks": "3.00 ± 1.53",
        "all arrive": "2 of 3",
        "source": "3 trials",
    }
    assert computed(7.0).cells()["asks"] == "7.00"
    assert computed(7.0).cells()["all arrive"] == "99.95 %"
    teams = by_run([of_trials(ROBOTS, arrived), of_trials(ROBOTS)])
    assert teams.cells()["all arrive"] == "83.3 % ± 16.7 %"


def test_plain_data_have_mean_spread_and_error_of_each_measure():
    data = by_run([of_trials(ROBOTS), of_trials(ROBOTS + 4)]).to_dict()
    assert (data["source"], data["runs"], data["trials"]) == ("trials", 2, 3)
    assert (data["returns"], data["returns_error"]) == (5.0, pytest.approx(2.0))
    assert data["arrived"] == 1.0
    names = ("returns", "time_to_goal", "miscoordinations", "asks", "arrived")
    parts = {name + part for name in names for part in ("", "_spread", "_error")}
    assert set(data) == {"source", "runs", "trials"} | parts
    assert "runs" not in computed(7.0).to_dict()


def test_a_data_frame_has_a_row_for_each_trial_or_run():
    trials = of_trials(ROBOTS).to_pandas()
    assert trials.returns.tolist() == MEANS
    assert set(trials.source) == {"trials"} and "returns_error" not in trials
    runs = by_run([of_trials(ROBOTS), of_trials(ROBOTS + 4)]).to_pandas()
    assert runs.returns.tolist() == [3.0, 7.0]
    assert runs.returns_error[0] == pytest.approx(math.sqrt(ROBOTS.var() / 3))
    exact = by_run([computed(7.0), computed(8.0)]).to_pandas()
    assert exact.returns_error.tolist() == [0.0, 0.0]
    assert set(exact.source) == {"exact"}


def test_it_shows_itself_in_one_line():
    assert repr(of_trials(ROBOTS)) == (
        "<Measures: 3 trials; return 3.00 ± 1.53, time to goal 3.00 ± 1.53, "
        "miscoordinations 3.00 ± 1.53, asks 3.00 ± 1.53, all arrive 3 of 3>"
    )


@pytest.mark.parametrize(
    "teams", [[], [None], [of_trials(ROBOTS), computed(7.0)], [of_trials(ROBOTS), 3]]
)
def test_other_things_are_no_teams(teams):
    with pytest.raises(SettingError, match="teams"):
        by_run(teams)


def test_an_unknown_measure():
    with pytest.raises(SettingError, match="'reward', allowed: returns, time_to_goal"):
        of_trials(ROBOTS).mean("reward")
