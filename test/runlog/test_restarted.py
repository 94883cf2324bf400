# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags whose recorder was killed and started again."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from rclpy.serialization import serialize_message
from recordings import copied, rolled_back

from sparse_coord_ros.log.bags import BagWriter
from sparse_coord_ros.log.bags.metadata import ROLLED_BACK
from sparse_coord_ros.log.bags.reader import open_bag
from sparse_coord_ros.log.bags.recover import continued
from sparse_coord_ros.log.runlog import read_run, verify
from sparse_coord_ros.log.runlog.attached import read_tables
from sparse_coord_ros.log.runlog.dialogue import Request, heard, times_asked_again
from sparse_coord_ros.log.runlog.difference import MISSING
from sparse_coord_ros.log.runlog.percepts import check_percepts
from sparse_coord_ros.log.runlog.replay import Interval, trajectory_of
from sparse_coord_ros.log.runlog.run_messages import asked_before, may_be_asked_before
from sparse_coord_ros.log.runlog.timeline import MARGIN, Rollback, superseded
from sparse_coord_ros.protocol.wire import RunState
from sparse_coord_ros.protocol.wire.events import EventKind
from sparse_coord_ros.protocol.wire.status import RunStatus
from sparse_coord_ros.ros.nodes.messages import status

AT = 120
"""The time step at which the recorder is killed."""


@pytest.fixture
def restarted(good, rewritten, tmp_path):
    """Return a function that writes a bag of two files; `after` picks what the second one holds.

    As ROS keeps tables for late readers, the second recorder gets some a second time.
    """
    bag = open_bag(good.bag)
    directory = tmp_path / "bag"

    def written(after, at=AT):
        cut = round(at * good.run.step_period * 1e9)

        def before(found):
            return [one for one in found if one.log_time_ns < cut]

        rewritten(good.bag, directory, before, before)
        writer = BagWriter(directory, earlier=continued(directory))
        tables = [one for one in bag.attachments if one.name.startswith("tables/")]
        again = [one for one in tables if not one.name.endswith("_0.npz")]
        copied(
            writer,
            bag,
            after([m for m in bag.messages() if m.log_time_ns >= cut]),
            again,
        )
        writer.close()
        return verify(directory)

    return written


def test_tables_that_come_again_are_known(restarted):
    found = restarted(list)
    assert found.differences == ()
    assert found.same


LATCHED = ("/map", "/markers", "/status", "/robot_1/coordination_map")


@pytest.mark.parametrize("waits", [False, True])
def test_a_recorder_may_come_late_if_the_world_does_not_wait_for_it(
    record, rewritten, tmp_path, waits
):
    """It gets the last message of each latched topic."""
    late = 40
    run = record(settings={"steps": 250}, values={"recorded": waits})
    cut = round(late * run.run.step_period * 1e9)

    def heard(messages):
        earlier = [one for one in messages if one.log_time_ns < cut]
        latched = {one.topic: one for one in earlier if one.topic in LATCHED}
        kept = [one for one in earlier if one.topic == "/run"] + [*latched.values()]
        return kept + [one for one in messages if one.log_time_ns >= cut]

    found = verify(rewritten(run.bag, tmp_path / "bag", heard))
    if waits:
        assert found.differences
        return
    assert found.differences == ()
    (gap,) = found.log.gaps
    assert gap.first == 1 and late <= gap.last + 1 <= late + 2
    assert [one[:2] for one in found.unknown] == [(0, 149)]


@pytest.mark.parametrize("at", [2, AT])
def test_a_recorder_that_comes_back_after_the_run_names_the_gap(restarted, at):
    def end(messages):
        return [one for one in messages if one.topic == "/status"][-1:]

    found = restarted(end, at)
    assert found.undecided
    (gap,) = found.log.gaps
    assert at - 5 <= gap.first <= at + 1
    assert gap.last == found.log.messages.statuses[-1].step
    assert [one[:2] for one in found.unknown] == [(max(0, gap.first - MARGIN), None)]


def test_a_recorder_that_comes_back_may_hear_a_robot_later_than_the_world(
    restarted, good
):
    """Earlier missed messages of the robot are a gap; later missed ones are not."""
    period = good.run.step_period * 1e9

    def deaf(first, last):
        def heard(message):
            missed = first * period <= message.log_time_ns < last * period
            return not (missed and message.topic.startswith("/robot_2/ac"))

        return lambda messages: [one for one in messages if heard(one)]

    found = restarted(deaf(AT, AT + 10))
    assert found.differences == ()
    assert found.undecided
    (gap,) = found.log.gaps
    assert gap.first <= AT + 1
    assert AT + 10 <= gap.last + 1 <= AT + 12
    first = restarted(deaf(AT + 10, AT + 20)).differences[0]
    assert first[:4] == (AT + 10, "robot_2", "action", MISSING)


@pytest.mark.parametrize("later", [0, 1])
def test_a_world_that_went_back_has_no_reward_to_say_again(good, tmp_path, later):
    """Before its next step; after that it repeats a state with its reward, or not at all."""
    found = verify(
        rolled_back(good, tmp_path / "bag", 150, after=25, again=150 + later)
    )
    due = (
        {f"time step {150 + later}, robot_{k}, local_state" for k in (1, 2)}
        if later
        else set()
    )
    assert {str(one).partition(":")[0] for one in found.differences} == due


@pytest.mark.parametrize("missed", [0, 3])
def test_a_recorder_that_comes_back_as_the_team_goes_back(record, tmp_path, missed):
    """It receives earlier tables from the robots, and may miss the first steps: a named gap."""
    run = record(settings={"steps": 200}, values={"checkpoint": 10})
    period = run.run.step_period * 1e9
    times = [one.log_time_ns for one in open_bag(run.bag).attachments]
    step = min(round(ns / period) for ns in times if ns > 50 * period)
    found = verify(rolled_back(run, tmp_path / "bag", step, after=25, missed=missed))
    gaps = [(step, step + missed - 1)] if missed else []
    assert found.log.messages.gaps == gaps
    assert found.differences == ()
    assert len(found.unknown) == len(gaps)
    assert all(one.first < gap[0] for one, gap in zip(found.unknown, gaps, strict=True))


LATE = ("/local_state", "/robot_1/reward", "/robot_2/action")


@pytest.mark.parametrize("late", [(), *((one,) for one in LATE)])
@pytest.mark.parametrize("after", [-1, 0, 1])
def test_a_killed_recorder_may_lack_the_last_steps_before_a_checkpoint(
    good, tmp_path, after, late
):
    """The team goes back to it: without these steps the tables then cannot be computed."""
    options = {"after": after, "killed": True, "late": late}
    found = verify(rolled_back(good, tmp_path / "bag", 150, **options))
    assert found.differences == ()
    [gap] = found.log.messages.gaps
    assert 145 <= gap.first <= gap.last == 149
    [unknown] = found.unknown
    assert unknown.first == gap.first - MARGIN
    assert unknown.last > 150, "it goes on at the next checkpoint"


def test_a_recorder_that_was_killed_well_after_a_checkpoint_lacks_nothing(
    good, tmp_path
):
    written = rolled_back(good, tmp_path / "bag", 150, after=25, killed=True)
    assert verify(written).same


def test_a_map_that_comes_again_is_known(restarted, good):
    """ROS keeps the last one for late readers."""
    maps = open_bag(good.bag).messages({"/map"})
    cut = AT * good.run.step_period * 1e9
    again = [one for one in maps if one.log_time_ns < cut][-1]
    assert restarted(lambda messages: [again, *messages]).same
    twice = [
        one.quantity
        for one in restarted(lambda rest: [again, again, *rest]).differences
    ]
    assert twice == ["map"]


def test_a_world_that_is_yet_to_go_back_does_not_know_the_step(restarted, good):
    said = RunStatus("", RunState.RESUMING, 1, 0, 0, "start")
    said = status("env1", said.state, said.values())
    messages = list(open_bag(good.bag).messages())
    cut = AT * good.run.step_period * 1e9
    ns = max(one.log_time_ns for one in messages if one.log_time_ns < cut)
    one = next(one for one in messages if one.topic == "/status")
    early = one._replace(
        data=serialize_message(said), log_time_ns=ns, publish_time_ns=ns
    )
    assert restarted(lambda messages: [early, *messages]).same


def test_an_answer_to_a_question_of_before_a_roll_back():
    """Of the last steps before it, or of the checkpoint if the answering robot has gone back."""
    back = Rollback(1, step=56, first=56, until=76)
    assert [step for step in range(50, 80) if may_be_asked_before(step, back)] == [
        *range(50, 57),
        *range(75, 80),
    ]
    assert not may_be_asked_before(56, None)


def test_a_question_of_before_a_roll_back_that_its_peer_answers_from_behind_it():
    """A recorder that was stopped writes it into the file after the roll-back."""
    back = Rollback(1, step=56, first=56, until=76)
    asked = [
        Request(0, 1, step, (0.5, 0.5), answer=(at, None))
        for step, at in ((56, 56), (57, 56), (58, 56), (58, 57))
    ]
    assert [asked_before(one, back) for one in asked] == [False, False, True, False]
    assert not any(asked_before(one, None) for one in asked)
    assert not asked_before(Request(0, 1, 70, (0.5, 0.5)), back)


def test_what_goes_back_supersedes():
    """Earlier files from its first time step on, and its own file before it."""
    back = Rollback(1, step=50, first=52, until=76)
    steps = range(48, 54)
    assert [one for one in steps if superseded(0, one, [back])] == [52, 53]
    assert [one for one in steps if superseded(1, one, [back])] == [48, 49]


def request(sent, returned, peer=1, step=9, answer=9):
    """Return a request of robot 1 for a step, with the times of its sending and its answer."""
    times = {EventKind.SENT: sent, EventKind.RETURNED: returned}
    return Request(0, peer, step, (0.0, 0.0), times, answer=(answer, None))


def test_of_requests_sent_again_the_newest_counts():
    """A peer that was stopped answers all of them, after its asker has given up the others."""

    superseded = request(1, 30)
    newest = request(20, 31)
    behind = request(1, 2, step=8)
    asked_again = request(3, 4, step=8)
    other = request(1, 30, peer=2)
    found = heard([superseded, newest, behind, asked_again, other])
    assert superseded not in found
    assert all(one in found for one in (newest, behind, asked_again, other))


@pytest.mark.parametrize(("until", "twice"), [(AT, []), (AT - 1, ["twice"])])
def test_tables_of_the_checkpoint_come_again_where_a_file_takes_the_run_back(
    good, until, twice
):
    """All robots continued with them; they are not steps that were recorded twice."""
    attached = open_bag(good.bag).attachments
    attachment = next(one for one in attached if one.name.startswith("tables/robot_1_"))
    attachment = replace(attachment, name=f"tables/robot_1_{AT}.npz")
    files = [
        SimpleNamespace(attachments=[attachment], continued=continued)
        for continued in (None, {"why": ROLLED_BACK})
    ]
    bag = SimpleNamespace(files=files)
    _, odd = read_tables(bag, good.run, [Rollback(1, AT, AT + 1, until)])
    assert [one.logged for one in odd if one.logged == "twice"] == twice


@pytest.mark.parametrize(
    ("answers", "times"),
    [([9], 0), ([8, 9], 1), ([8, 8, 9], 2), ([8, 8], 1), ([9, 10], 0), ([8, 9, 9], 1)],
)
def test_a_busy_robot_that_asks_again_does_not_wait_for_its_peer(answers, times):
    """It had an answer of the same step, and did not read it in time."""
    requests = [
        request(2 * i, 2 * i + 1, answer=answer) for i, answer in enumerate(answers)
    ]
    other = request(90, 91, peer=2, answer=8)
    assert times_asked_again(heard([*requests, other])) == times


def test_a_busy_robot_acts_on_the_answer_that_had_come(good):
    """And not on the answer to its repeated request, when its peer was at a later step."""
    log = verify(good.bag).log
    one = next(
        r for r in log.requests if r.answer is not None and r.answer[1] is not None
    )
    later = max(request.wall_ns.get(EventKind.RETURNED, 0) for request in log.requests)
    wall = {kind: later + 1 + kind for kind in range(4)}

    trajectories = [trajectory_of(log, k, Interval()) for k in range(2)]

    def odd(answer):
        again = replace(one, wall_ns=wall, answer=answer, said=answer)
        changed = log.with_changes(requests=(*log.requests, again))
        return check_percepts(changed, trajectories)

    assert odd((one.step + 1, None)) == []
    assert odd(one.answer) == []
    assert odd((one.step, None)) != [], "a refusal that its peer cannot have given"


def with_request(log, changes):
    """Return the differences of a log in which the first refused request is changed."""
    requests = list(log.requests)
    refused = [one.answer == (one.step, None) for one in requests]
    place = refused.index(True)
    requests[place] = replace(requests[place], **changes(requests[place]))
    trajectories = [trajectory_of(log, k, Interval()) for k in range(2)]
    return check_percepts(log.with_changes(requests=tuple(requests)), trajectories)


def test_a_peer_that_was_a_step_further_refuses(good):
    def further(one):
        return {"answer": (one.step + 1, None), "said": (one.step + 1, None)}

    assert with_request(read_run(good.bag), further) == []


def test_a_robot_asks_from_where_it_is(good):
    """Even if all four events of a request agree."""
    log = read_run(good.bag)
    [found] = with_request(log, lambda one: {"position": (0.25, 0.25)})
    assert found.quantity.startswith("dialogue") and "(0.25, 0.25)" in found.logged
