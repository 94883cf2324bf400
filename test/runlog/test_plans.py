# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Plans in a log: each follows from the learned memories, or `verify` reports it."""

import itertools

import pytest
from forging import Forgery, forged, read, unpacked, write
from recordings import recorded

from sparse_coord_ros.base.compiling import has_numba
from sparse_coord_ros.log.runlog import verify

pytestmark = pytest.mark.skipif(not has_numba(), reason="minutes in plain Python")

SETTINGS = {"steps": 80, "perception": "probability:0.5"}
PLANNING = {"learner": "factored", "improve": True, "checkpoint": 0}
PLAN = "improved/robot_1.npz"


def bag_of(folder, **options):
    return read(recorded(folder, "env1", SETTINGS, values=PLANNING, **options).bag)


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """Return the bag of a run whose robots have plans."""
    return bag_of(tmp_path_factory.mktemp("planned"))


@pytest.fixture
def asked(tmp_path):
    """Return a function that writes a forged bag and verifies it."""
    number = itertools.count()
    return lambda bag, *done: verify(
        write(forged(bag, done), tmp_path / f"bag_{next(number)}")
    )


def last_tables(bag):
    names = [
        one.name
        for one in bag[-1].attachments
        if one.name.startswith("tables/robot_1_")
    ]
    return names[-1]


def test_plans_follow_from_what_was_learned(planned, asked):
    found = asked(planned)
    assert found.same


def test_that_a_robot_kept_its_tables_nobody_can_tell(planned, asked, tmp_path_factory):
    """A peer may not have sent its memory; or a forger has put the tables there."""
    honest = bag_of(tmp_path_factory.mktemp("kept"), alone=(0,))
    found = asked(honest)
    [unknown] = found.unknown
    assert found.undecided and "robot_1 kept its own tables" in unknown.why


@pytest.mark.parametrize("how", ["", "without counts"])
def test_tables_in_the_place_of_a_plan(planned, asked, how):
    """The robot's own may be there, as above, if all of them are."""
    found = asked(planned, Forgery("plan", (last_tables(planned), PLAN), how))
    assert not found.same
    assert found.undecided == (how == "")


def test_a_forged_plan_beside_the_right_one(planned, asked):
    for where in ("forged before", "forged behind"):
        [odd] = asked(planned, Forgery("attachment", (PLAN,), where)).differences
        assert odd.robot == "robot_1" and odd.quantity.startswith(f"{PLAN} q_star[")


def test_the_counts_beside_a_plan_are_those_of_the_last_tables(planned, asked):
    [one] = [one for one in planned[-1].attachments if one.name == PLAN]
    names = sorted(name for name in unpacked(one.data) if name.startswith("count_"))
    assert len(names) == 7
    for name in names:
        [odd] = asked(planned, Forgery("entry", (PLAN, name, 0), "far")).differences
        assert odd.quantity == f"{PLAN} {name}"


def test_after_a_difference_no_plan_is_compared(planned, asked):
    """The robots' memories at the end are then unknown."""
    found = asked(planned, Forgery("message", ("/robot_1/reward", 20), "removed"))
    assert found.differences
    assert all("improved" not in one.quantity for one in found.differences)


def test_a_run_that_says_no_improve_has_no_plans(planned, asked):
    found = asked(planned, Forgery("setting", ("improve",), False))
    assert [(one.quantity, one.computed) for one in found.differences] == [
        (f"improved/robot_{k}.npz", "none: no plan is due") for k in (1, 2)
    ]


def test_a_plan_that_is_missing_is_an_open_question(planned, asked):
    """A robot may have been stopped before it had one."""
    found = asked(planned, Forgery("attachment", (PLAN,), "removed"))
    [unknown] = found.unknown
    assert found.undecided and "robot_1 made no plan" in unknown.why


def test_a_run_that_was_stopped_has_no_plans(asked, tmp_path):
    bag = bag_of(tmp_path / "stopped", stop=40)
    assert asked(bag).same
    found = asked(bag, Forgery("plan", (last_tables(bag), PLAN), "without counts"))
    assert [one.computed for one in found.differences] == ["none: no plan is due"]


def test_without_last_tables_nobody_can_tell_a_plan(planned, asked):
    """Only their counts show whether the robot learned from its last action."""
    lost = Forgery("lost", ("tables/robot_1_", 1, 1000), "named")
    found = asked(planned, lost)
    assert not found.differences
    whys = [one.why for one in found.unknown]
    assert sum("robot_1 learned from the last action" in why for why in whys) == 1
