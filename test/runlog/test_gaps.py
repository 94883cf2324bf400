# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A part of a bag is lost: the run before it and from the next checkpoint on is verified."""

import random
import re
from collections import Counter
from copy import copy
from functools import cache
from io import BytesIO

import forging
import numpy as np
import pytest
import zstandard
from forging import Forgery
from mcap.data_stream import ReadDataStream
from mcap.records import Chunk
from mcap.stream_reader import CRCValidationError, breakup_chunk
from recordings import Attached, each
from sensor_msgs.msg import JointState

from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.runs.run_config import RUN_RECORD
from sparse_coord_ros.core.runs.tables import pack_tables, unpack_saved
from sparse_coord_ros.log.bags import BagWriter, open_bag
from sparse_coord_ros.log.bags.recover import recover
from sparse_coord_ros.log.runlog import read_run, verify
from sparse_coord_ros.log.runlog.explain import coordinations, explained
from sparse_coord_ros.log.runlog.replay import intervals
from sparse_coord_ros.log.runlog.timeline import (
    MARGIN,
    Jump,
    LostSteps,
    with_jumps,
)
from sparse_coord_ros.log.runlog.window import LongLog

CHUNK = 20_000
EVERY = 40
"""Time steps between checkpoints."""
RECORD_HEAD = 9
"""Bytes of a record's opcode and length."""
SOME = (1, 2, 5, 11, 17, -2)


@pytest.fixture(scope="module")
def chunked(record):
    """A run whose bag has 20 chunks or more."""
    settings = {"perception": "probability:0.5", "steps": 400, "max_steps": 20}
    return record(settings=settings, values={"checkpoint": EVERY}, chunk=CHUNK)


@pytest.fixture(scope="module")
def factored(record):
    """A run of robots with more memory than tables."""
    values = {"checkpoint": EVERY, "learner": "factored"}
    return record(
        settings={"perception": "probability:0.5"}, values=values, chunk=CHUNK
    )


@pytest.fixture
def flipped(tmp_path):
    """Return a function that changes a byte of a chunk; it returns the file and the block."""

    def flip(bag, place):
        bag = open_bag(bag)
        block = bag.blocks[0][place]
        data = bytearray(bag.path.read_bytes())
        data[block.offset + block.length // 2] ^= 0xFF
        (tmp_path / "flipped_0.mcap").write_bytes(data)
        return tmp_path / "flipped_0.mcap", block

    return flip


def lost_parts(found):
    """Return the first and last time step of each part that is lost; None: to the end."""
    return [(one.first, one.last) for one in intervals(found.log) if one.lost]


def chunk_at(bag, step, period):
    """Return the place of a time step's chunk."""
    blocks = open_bag(bag).blocks[0]
    return next(p for p, one in enumerate(blocks) if one.end_ns >= step * period)


@cache
def verified(bag):
    """Verify an undamaged bag, once for all comparisons."""
    return verify(bag)


def check(run, path, block):
    """Check the findings on a bag with one lost chunk."""
    whole = verified(run.bag)
    found = verify(path)
    period = run.run.step_period * 1e9
    assert found.differences == (), found.first
    assert found.undecided
    inside = [m for m in open_bag(run.bag).messages() if block.start_ns < m.log_time_ns]
    inside = [m for m in inside if m.log_time_ns < block.end_ns]
    kept = whole.log.bag.message_count - found.log.bag.message_count
    assert kept >= len(inside) * 0.9
    for gap in found.log.gaps:
        assert gap.first >= block.start_ns / period - 2
        assert gap.last is None or gap.last <= block.end_ns / period + 2
    open_steps = sum(
        np.count_nonzero(
            (whole.log.step >= first) & (whole.log.step <= (last or 10**9))
        )
        for first, last in lost_parts(found)
    )
    assert found.steps >= whole.steps - open_steps - 1
    return found


@pytest.mark.parametrize("place", SOME)
def test_one_bad_chunk_costs_what_follows_up_to_the_next_checkpoint(
    chunked, flipped, place
):
    found = check(chunked, *flipped(chunked.bag, place))
    [(first, last)] = lost_parts(found)
    assert (last is None) == (place == -2) or place == -2
    if last is not None:
        tables = {one.step for one in found.log.all_tables}
        assert last + 1 in tables and first < found.log.gaps[0].first
        assert found.tables > 2 * sum(step < first for step in tables)


@pytest.mark.long
@pytest.mark.timeout(900)
def test_every_chunk(chunked, factored, flipped):
    for run in (chunked, factored):
        for place in range(1, len(open_bag(run.bag).blocks[0])):
            check(run, *flipped(run.bag, place))


def outcome(path):
    """Return messages kept, bytes of each gap, attachments, and `verify`'s verdict in a word."""
    found = verify(path)
    bag = found.log.bag
    holes = [last is not None for _, last in lost_parts(found)]
    verdict = "undecided at some steps" if any(holes) else "undecided from a step on"
    if not holes:
        verdict = "identical" if found.same else "undecided about the run's data"
    assert not found.differences, found.first
    gaps = [(gap.begin, gap.end) for gap in bag.gaps]
    return bag.message_count, gaps, len(bag.attachments), verdict


def as_recorded(bag, directory):
    """Return a copy of a bag that registers its topics and flushes at once, as a recorder does."""
    bag = open_bag(bag)
    attachments = list(bag.attachments)
    with BagWriter(directory, chunk_size=CHUNK) as writer:
        writer.add_metadata(RUN_RECORD, bag.metadata[RUN_RECORD])
        channels = {
            topic.name: writer.add_known_topic(topic) for topic in bag.topics.values()
        }
        for place, (topic, *message) in enumerate(bag.messages()):
            while attachments and attachments[0].log_time_ns <= message[1]:
                one = attachments.pop(0)
                writer.attach(one.name, one.data, one.media_type, one.log_time_ns)
            writer.write(channels[topic], *message)
            if not place:
                writer.flush()
        for one in attachments:
            writer.attach(one.name, one.data, one.media_type, one.log_time_ns)
    return open_bag(directory)


def unpacks(record):
    """Return whether a chunk still fits its checksum, by the package mcap."""
    chunk = Chunk.read(ReadDataStream(BytesIO(record[RECORD_HEAD:])))
    try:
        breakup_chunk(chunk, validate_crc=True)
    except (CRCValidationError, RuntimeError, zstandard.ZstdError):
        return False
    return True


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("finished", [True, False])
def test_the_table_of_damages(chunked, tmp_path, finished):
    """All undamaged parts are verified; `-m long -s -k table_of` prints them."""
    draw = random.Random(7)
    bag = as_recorded(chunked.bag, tmp_path / "copy")
    data = bag.path.read_bytes()
    if not finished:
        data = data[: bag.files[0].readable_bytes]
    path = tmp_path / ("bag_0.mcap" if finished else "bag_0.mcap.partial")
    blocks = [(one.offset, one.offset + one.length) for one in bag.blocks[0]]
    counts = [
        len(part.begins) for one in bag.blocks[0] for part in bag.files[0].parts([one])
    ]
    every = len(bag.attachments)
    total = sum(counts)
    cases = {"one bit of a chunk": [], "junk between two chunks": [], "cut": []}

    def note(case, changed, kept, gaps, attached):
        path.write_bytes(changed)
        found = outcome(path)
        assert found[:3] == (kept, gaps, attached), (case, found)
        cases[case].append((kept, found[3]))

    for (begin, end), count in zip(blocks, counts, strict=True):
        changed = bytearray(data)
        # The decompressor does not need every bit; a flip of another one does no harm.
        while unpacks(changed[begin:end]):
            changed = bytearray(data)
            changed[draw.randrange(begin + 60, end)] ^= 1 << draw.randrange(8)
        note("one bit of a chunk", changed, total - count, [(begin, end)], every)
    for begin, _ in blocks[1:]:
        changed = data[:begin] + draw.randbytes(100) + data[begin:]
        note("junk between two chunks", changed, total, [(begin, begin + 100)], every)
    data_end = bag.files[0].readable_bytes
    for place in sorted(draw.sample(range(blocks[0][1], data_end), 50)):
        path.write_bytes(data[:place])
        kept = sum(
            n for (_, end), n in zip(blocks, counts, strict=True) if end <= place
        )
        attached = sum(one.offset + one.size + 4 <= place for one in bag.attachments)
        [*before, gap] = open_bag(path).gaps or [None]
        assert not before and (gap is None or gap.end == place)
        note("cut", data[:place], kept, [gap[:2]] if gap else [], attached)
    print(
        f"\n{len(blocks)} chunks, {total} messages, {'finished' if finished else 'unfinished'}"
    )
    for case, found in cases.items():
        kept = [one for one, _ in found]
        verdicts = Counter(verdict for _, verdict in found)
        told = ", ".join(f"{n} {verdict}" for verdict, n in verdicts.most_common())
        print(f"| {case} | {len(found)} | {min(kept)} to {max(kept)} | {told} |")


@pytest.mark.parametrize("place", (5, 12))
def test_what_else_an_agent_remembers_goes_on_too(factored, flipped, place):
    found = check(factored, *flipped(factored.bag, place))
    assert lost_parts(found)[0][1] is not None and found.updates > 200


def test_what_is_said(chunked, flipped, capsys):
    path, block = flipped(chunked.bag, 5)
    assert main(["verify", str(path)]) == 3
    out = capsys.readouterr().out
    assert (
        f"lost: flipped_0.mcap, bytes {block.offset} to {block.offset + block.length} ("
        in out
    )
    [(first, last)] = lost_parts(verify(path))
    assert f"undecided from time step {first} to time step {last}: " in out
    assert "differs" not in out and out.endswith("all else is identical\n")
    path, block = flipped(chunked.bag, -1)
    assert main(["verify", str(path)]) == 3
    out = capsys.readouterr().out
    assert re.search(r"undecided from time step \d+ on: ", out)


def test_a_recovered_bag_has_the_same_gap(chunked, flipped):
    path, _ = flipped(chunked.bag, 5)
    before = verify(path)
    found = verify(recover(path).path)
    assert found.differences == () and found.undecided
    assert found.log.gaps[0] == before.log.gaps[0]
    assert lost_parts(found)[0] == lost_parts(before)[0]


def test_a_difference_elsewhere_still_differs(chunked, rewritten, flipped, tmp_path):
    """Also after the gap, in the computation from the next checkpoint on."""
    log = verify(chunked.bag).log
    period = chunked.run.step_period * 1e9
    rewarded = log.messages.rewards[0].step

    def lower(message):
        message.position[1] -= 1.0
        message.position[3] -= 1.0

    for place in (len(rewarded) // 4, -20):
        step = int(rewarded[place])
        change = each(
            "/robot_1/reward", JointState, lower, slice(place, place + 1 or None)
        )
        bag = rewritten(chunked.bag, tmp_path / "bag", change, chunk_size=CHUNK)
        assert [one.step for one in verify(bag).differences[:1]] == [step]
        path, _ = flipped(bag, chunk_at(bag, 150, period))
        found = verify(path)
        assert [one.step for one in found.differences[:1]] == [step], lost_parts(found)


def changed_tables(step, how):
    """Return a change of robot_1's tables of a checkpoint."""

    def attach(found):
        place = next(
            p for p, one in enumerate(found) if one.name == f"tables/robot_1_{step}.npz"
        )
        [saved] = unpack_saved(found[place].data, [1], where="")
        memory = dict(saved.memory)
        how(memory)
        data = pack_tables({1: memory}, counts=saved.counts)
        found[place] = Attached(*found[place])._replace(data=data)
        return found

    return attach


def without_counts(memory):
    del memory["updates"]


def that_breaks(memory):
    memory["q_coord_keys"] = memory["q_coord_keys"] + 10_000


@pytest.mark.parametrize("how", [without_counts, that_breaks])
def test_tables_that_nobody_can_go_on_from_are_no_checkpoint(
    chunked, rewritten, flipped, tmp_path, how
):
    path, _ = flipped(chunked.bag, 5)
    step = lost_parts(verify(path))[0][1] + 1
    change = changed_tables(step, how)
    bag = rewritten(chunked.bag, tmp_path / "bag", attach=change, chunk_size=CHUNK)
    place = chunk_at(bag, verify(path).log.gaps[0].first, chunked.run.step_period * 1e9)
    found = verify(flipped(bag, place)[0])
    assert lost_parts(found)[0][1] > step
    assert found.differences == ()


def test_a_single_lost_step_looks_like_an_episodes_end_and_is_none(chunked):
    """A checkpoint later in that episode is none: the log lacks the episode's start."""
    log = read_run(chunked.bag)
    used = 0
    for at in sorted({one.step for one in log.all_tables}):
        gone = at - MARGIN - 1
        rows = [log.row_of.get(step) for step in (gone - 1, gone, at)]
        if None in rows or len(set(log.episode[rows])) > 1:
            continue
        kept = log.step != gone
        arrays = {
            name: value[kept]
            for name, value in vars(log).items()
            if isinstance(value, np.ndarray)
        }
        messages = copy(log.messages)
        messages.gaps = [LostSteps(gone, gone)]
        changed = log.with_changes(messages=messages, **arrays)
        assert at not in [one.first for one in intervals(changed)]
        used += 1
    assert used > 0


def test_tables_of_a_step_that_nobody_was_at_are_no_checkpoint(
    chunked, rewritten, flipped, tmp_path
):
    def attach(found):
        last = [one for one in found if one.name.startswith("tables")][-2:]
        far = [re.sub(r"(robot_\d)_\d+", r"\1_999999", one.name) for one in last]
        return [
            *found,
            *(o._replace(name=name) for o, name in zip(last, far, strict=True)),
        ]

    bag = rewritten(chunked.bag, tmp_path / "bag", attach=attach, chunk_size=CHUNK)
    found = verify(flipped(bag, -2)[0])
    assert found.differences == () and lost_parts(found)[-1][1] is None


def test_a_count_of_the_world_that_goes_back_is_no_checkpoint(
    chunked, rewritten, flipped, tmp_path
):
    """A forger who hides an action and its reward must reduce the count of the next status."""
    period = chunked.run.step_period * 1e9
    path, _ = flipped(chunked.bag, 5)
    [(_, last)] = lost_parts(verify(path))
    lost_at = verify(path).log.gaps[0].first
    log = verify(chunked.bag).log
    both = np.intersect1d(*(track.step for track in log.messages.rewards))
    step = int(both[both > last][0])
    assert step <= min(one.step for one in log.messages.statuses if one.step > last)

    def change(messages):
        hidden = [
            (f"/robot_1/{name}", round(step * period)) for name in ("action", "reward")
        ]
        return [one for one in messages if (one.topic, one.log_time_ns) not in hidden]

    bag = rewritten(chunked.bag, tmp_path / "bag", change, chunk_size=CHUNK)
    found = verify(flipped(bag, chunk_at(bag, lost_at, period))[0])
    assert lost_parts(found)[0][1] > last


def test_a_lost_attachment_costs_no_time_step(chunked, tmp_path):
    bag = open_bag(chunked.bag)
    data = bytearray(bag.path.read_bytes())
    one = [one for one in bag.attachments if "robot_1" in one.name][5]
    data[one.offset + one.size // 2] ^= 1
    path = tmp_path / "bad_0.mcap"
    path.write_bytes(data)
    found = verify(path)
    whole = verify(chunked.bag)
    assert found.differences == () and found.undecided
    assert not lost_parts(found) and found.log.gaps == []
    [unknown] = found.unknown
    assert unknown.first == unknown.last and "tables of robot_1" in unknown.why
    assert (found.steps, found.updates) == (whole.steps, whole.updates)
    assert found.tables == whole.tables - 1


def test_an_undamaged_log_whose_numbers_jump_differs(chunked, rewritten, tmp_path):
    number = len(verify(chunked.bag).log.messages.rewards[0].step) // 2
    bag = rewritten(chunked.bag, tmp_path / "bag", gap=("/robot_1/reward", number))
    assert any("number" in one.logged for one in verify(bag).differences)


def test_each_coordinate_is_explained_as_far_as_it_is_known(chunked, flipped, capsys):
    path, _ = flipped(chunked.bag, 5)
    log = read_run(path)
    whole = read_run(chunked.bag)
    [(first, last), *_] = lost_parts(verify(path))
    steps = coordinations(log, 1)
    due_at = {one.step: one for one in explained(whole, 1, steps)}
    seen = set()
    for told in explained(log, 1, steps):
        due = due_at[told.step]
        lost_then = first <= told.step <= last
        seen.add(lost_then)
        assert (told.q_values == ()) == lost_then and told.agrees
        if lost_then:
            assert told.update is None and told.perceived == due.perceived
        else:
            assert (told.q_values, told.update) == (due.q_values, due.update)
    assert seen == {False, True}
    step = next(step for step in steps if first <= step <= last)
    assert main(["explain", str(path), "--step", str(step), "--robot", "robot_2"]) == 0
    out = capsys.readouterr().out
    assert (
        out.startswith("lost: flipped_0.mcap, bytes ")
        and "its update are unknown" in out
    )


def test_the_history_leaves_out_what_is_cut(chunked, flipped):
    path, _ = flipped(chunked.bag, 5)
    log = read_run(path)
    whole = read_run(chunked.bag).history()
    cut = log.history()
    [gap] = log.gaps
    rows = np.isin(whole.first_step, cut.first_step)
    assert np.array_equal(whole.length[rows], cut.length)
    assert np.array_equal(whole.returns[rows], cut.returns)
    assert 0 < rows.sum() < len(rows)
    lengths = whole.first_step + whole.length
    assert rows[lengths < gap.first].all() and rows[whole.first_step > gap.last].all()
    long = LongLog(path)
    parts = list(long.episodes())
    assert sum(part.history.episodes for part in parts) == cut.episodes
    assert long.losses and log.losses[0] == long.losses[0]
    long.bag.close()


def test_a_part_of_a_bag_has_no_gap_before_it(chunked, flipped):
    path, _ = flipped(chunked.bag, 5)
    long = LongLog(path)
    assert long.read(200, 300).gaps == [] and len(long.read(200, 300).step) > 80
    long.bag.close()


def lost_states(first, how=""):
    return Forgery("lost", ("/robot_1/local_state", first, first + 3), how)


def verified_without(good, folder, *done):
    bag = forging.forged(forging.read(good.bag), done)
    return verify(forging.write(bag, folder / "bag"))


def test_what_a_recorder_missed_while_it_stood_still(good, tmp_path):
    found = verified_without(good, tmp_path, lost_states(100, "named"))
    [unknown] = found.unknown
    assert found.undecided and unknown.last is None
    assert 100 <= unknown.first <= 104 and "stood still for 9.0 s" in unknown.why


def test_what_is_missing_before_the_recorder_stood_still_differs(good, tmp_path):
    done = lost_states(50), lost_states(100, "named")
    found = verified_without(good, tmp_path, *done)
    assert found.first[:4] == (50, "robot_1", "local_state", "missing")


def jump(topic, before, after):
    return Jump(topic, before, after, None)


@pytest.mark.parametrize(
    ("known", "jumps", "found"),
    [
        ([], [jump("/percept", 20, 700), jump("/clock", 100, 200)], [(11, 19)]),
        (
            [],
            [
                jump("/percept", 20, 700),
                jump("/reward", 90, 210),
                jump("/clock", 100, 200),
            ],
            [(11, 19)],
        ),
        (
            [(12, 18)],
            [jump("/clock", 100, 200), jump("/clock", 500, 560)],
            [(12, 18), (51, 55)],
        ),
        ([], [jump("/clock", 50, 60)], [(6, 6)]),
        ([(30, 40)], [jump("/clock", 340, 460)], [(30, 40)]),
        ([(30, 40)], [jump("/clock", 350, 460)], [(30, 40), (36, 45)]),
        ([(30, 40)], [jump("/clock", 200, 360)], [(30, 40)]),
        ([(30, 40)], [jump("/clock", 200, 350)], [(30, 40), (21, 34)]),
    ],
)
def test_where_numbers_say_that_a_gap_is(known, jumps, found):
    """The narrowest jump shows the gap best; time steps of 10 ns."""
    gaps = [LostSteps(*one) for one in known]
    assert with_jumps(gaps, jumps, 10) == [LostSteps(*one) for one in found]
