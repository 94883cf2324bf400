# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Order, time steps, kept topics and deadlines of playing, with a clock that tests control."""

import random
from pathlib import Path

import numpy as np
import pytest

from sparse_coord_ros.log.bags.heads import MESSAGE_HEAD
from sparse_coord_ros.log.bags.playback import BURST, Playback
from sparse_coord_ros.log.bags.playlist import Playlist
from sparse_coord_ros.log.bags.reader import Bag, Message, Part
from sparse_coord_ros.log.bags.topics import BagTopic
from sparse_coord_ros.protocol.wire import CLOCK

MS = 1_000_000
TOPICS = ("/a", "/b", "/clock", "/map")


def type_of(name):
    return CLOCK.type_name if name.endswith("/clock") else "std_msgs/msg/String"


class Log(Bag):
    """A bag of (topic, log time in ms) in memory; the data are the place in the file."""

    def __init__(self, *entries, start_ns=0):
        super().__init__([Path("log")])
        self.entries = [
            Message(topic, str(place).encode(), start_ns + round(at * MS), 0, 0)
            for place, (topic, at) in enumerate(entries)
        ]
        self.names = sorted({one.topic for one in self.entries})
        self.topics = {name: BagTopic(name, type_of(name), "") for name in self.names}
        heads = np.zeros(len(self.entries), MESSAGE_HEAD)
        heads["topic"] = [self.names.index(one.topic) for one in self.entries]
        heads["log_ns"] = [one.log_time_ns for one in self.entries]
        heads["size"] = [len(one.data) for one in self.entries]
        self.files[0].note(heads, self.names)
        content = b"".join(one.data for one in self.entries)
        begins = np.cumsum([0, *heads["size"][:-1]])
        self.parts = [Part(0, content, begins, heads)]


def places(messages):
    return [int(message.data) for message in messages]


def rest(playlist):
    taken = []
    while playlist.next_ns is not None:
        taken.append(playlist.take())
    return taken


def run_log(steps, step_ms=100):
    """Return a bag like the recorder's: a map each 10 steps, a clock each, two topics."""
    entries = []
    for step in range(steps):
        if step % 10 == 0:
            entries.append(("/map", step * step_ms))
        entries += [(topic, step * step_ms) for topic in ("/clock", "/a", "/b")]
    return Log(*entries)


class Stage:
    """A playback, its clock and its published messages."""

    def __init__(self, log, *, kept=("/map", "/clock"), topics=TOPICS, **options):
        self.now = 5_000_000_000
        self.out = []
        self.times = []
        self.publish_takes = 0
        self.playback = Playback(
            Playlist(log, topics, kept),
            self._publish,
            lambda: self.now,
            on_time=self.times.append,
            **options,
        )
        self.playback.seek(0)

    def _publish(self, message):
        self.now += self.publish_takes
        self.out.append((self.now, message))

    def run(self, ms=float("inf"), late=0):
        """Play so long; every wait lasts `late` longer than requested."""
        until = self.now + ms * MS
        while (wait := self.playback.play()) is not None and self.now + wait <= until:
            self.now += wait + (late if wait else 0)
        if until != float("inf"):
            self.now = max(self.now, until)

    def taken(self):
        """Return the places in the file of the messages since the last call."""
        found = places(message for _, message in self.out)
        self.out.clear()
        return found


@pytest.mark.parametrize("seed", range(8))
def test_any_order_in_the_file_any_seek(seed):
    draw = random.Random(seed)
    log = Log(
        *[
            (draw.choice(TOPICS), draw.randrange(50))
            for _ in range(draw.randrange(1, 200))
        ]
    )
    wanted = sorted(log.entries, key=lambda message: message.log_time_ns)
    playlist = Playlist(log, TOPICS, ("/map", "/clock"))
    assert len(playlist) == len(wanted)
    assert rest(playlist) == wanted
    for _ in range(20):
        at = draw.randrange(-5, 60) * MS
        before = [m for m in wanted if m.log_time_ns < at]
        lasts = {m.topic: m for m in before if m.topic in ("/map", "/clock")}
        assert playlist.seek(at) == sorted(lasts.values(), key=before.index)
        part = wanted[len(before) :][: draw.randrange(200)]
        for message in part:
            assert playlist.take() == message
    assert rest(playlist) == wanted[len(before) + len(part) :]


def test_only_chosen_topics_are_read():
    log = run_log(20)
    playlist = Playlist(log, ("/a", "/clock"), ("/map", "/clock"))
    assert {message.topic for message in rest(playlist)} == {"/a", "/clock"}
    assert [m.topic for m in playlist.seek(500 * MS)] == ["/clock"]


def test_a_time_step_ends_before_the_next_clock():
    log = Log(
        ("/a", 1),
        ("/clock", 2),
        ("/a", 2),
        ("/b", 3),
        ("/a", 4),
        ("/clock", 5),
        ("/b", 6),
    )
    stage = Stage(log, paused=True)
    steps = [stage.taken()]
    while stage.playback.step():
        steps.append(stage.taken())
        stage.taken()
    assert steps == [[], [0], [1, 2, 3, 4], [5, 6]]


def test_without_a_clock_a_time_step_has_one_log_time():
    log = Log(("/a", 1), ("/b", 1), ("/a", 2), ("/b", 4), ("/a", 4))
    stage = Stage(log, paused=True)
    steps = []
    while stage.playback.step():
        steps.append((stage.taken(), stage.playback.position_ns // MS))
    assert steps == [([0, 1], 1), ([2], 2), ([3, 4], 4)]
    assert not stage.playback.done


@pytest.mark.parametrize("rate", [0.25, 1.0, 8.0])
def test_deadlines_are_absolute(rate):
    """Waits that end late and slow publishing delay a message, but none after it."""
    stage = Stage(run_log(50), rate=rate)
    begin = stage.now
    stage.publish_takes = 10_000
    stage.run(late=3 * MS)
    assert stage.playback.done and places(message for _, message in stage.out) == [
        *range(155)
    ]
    for at, message in stage.out[4:]:
        late = at - begin - message.log_time_ns / rate
        assert 3 * MS <= late < 3 * MS + 5 * 10_000
    assert stage.playback.late_ns == 3 * MS + 40_000
    assert set(stage.times) == {message.log_time_ns for _, message in stage.out}


def test_a_late_player_catches_up_in_bursts():
    stage = Stage(run_log(1000))
    stage.now += 90_000 * MS
    stage.taken()
    assert stage.playback.play() == 0
    assert len(stage.taken()) == BURST
    stage.run(ms=0)
    assert stage.playback.position_ns == 90_000 * MS
    assert stage.playback.late_ns == (90_000 - 100) * MS


def test_pause_holds_time_and_resume_goes_on_from_there():
    stage = Stage(run_log(100))
    stage.run(ms=250)
    assert stage.taken() == list(range(10))
    stage.playback.pause(True)
    assert stage.playback.play() is None
    stage.now += 10_000 * MS
    assert stage.playback.position_ns == 250 * MS
    assert stage.playback.play() is None
    stage.playback.pause(False)
    assert stage.playback.play() == 50 * MS
    stage.run(ms=49)
    assert stage.taken() == []
    stage.run(ms=1)
    assert stage.taken() == [10, 11, 12]
    stage.playback.pause(False)
    assert stage.playback.play() == 100 * MS, "going on twice changes nothing"


@pytest.mark.parametrize("gap_ms", [4_900, 5_100, 10**9])
@pytest.mark.parametrize("waits", [False, True])
def test_a_gap_is_jumped_over_unless_one_waits(gap_ms, waits):
    """Before and after it all messages keep their distances."""
    gaps = []
    jump = None if waits else lambda *times: gaps.append(times)
    log_ms = [0, 100, 200, 200 + gap_ms, 300 + gap_ms]
    stage = Stage(Log(*[("/clock", at) for at in log_ms]), on_gap=jump)
    begin = stage.now
    stage.run()
    published = [(now - begin) // MS for now, _ in stage.out]
    if waits or gap_ms < 5_000:
        assert (published, gaps) == (log_ms, [])
    else:
        assert published == [0, 100, 200, 200, 300]
        assert gaps == [(200 * MS, (200 + gap_ms) * MS)]


def test_slow_steps_are_no_gaps():
    gaps = []
    stage = Stage(run_log(5, step_ms=60_000), on_gap=lambda *times: gaps.append(times))
    stage.run()
    assert gaps == [] and stage.playback.done


def test_a_new_rate_counts_from_now_on():
    stage = Stage(run_log(100))
    stage.run(ms=150)
    stage.playback.set_rate(10.0)
    stage.taken()
    assert stage.playback.play() == 5 * MS
    stage.run(ms=15)
    assert stage.playback.position_ns == 300 * MS
    assert len(stage.taken()) == 6
    stage.playback.pause(True)
    stage.playback.set_rate(0.5)
    stage.playback.pause(False)
    assert stage.playback.play() == 200 * MS


def test_a_step_pauses_and_playing_goes_on_after_it():
    stage = Stage(run_log(100))
    stage.run(ms=150)
    stage.taken()
    assert stage.playback.step()
    assert stage.playback.paused
    assert stage.taken() == [7, 8, 9]
    assert stage.playback.position_ns == 200 * MS
    stage.now += 5_000 * MS
    stage.playback.pause(False)
    assert stage.playback.play() == 100 * MS


@pytest.mark.parametrize("paused", [False, True])
@pytest.mark.parametrize("before", [0, 4_500])
def test_a_seek_makes_kept_topics_current_and_shows_its_own_time(paused, before):
    """Forward and backward: map and clock, then all of exactly that time, paused or not."""
    log = run_log(100)
    stage = Stage(log)
    stage.run(ms=before)
    stage.playback.pause(paused)
    stage.taken()
    stage.playback.seek(2_550 * MS)
    shown = [log.entries[place] for place in stage.taken()]
    assert [(m.topic, m.log_time_ns // MS) for m in shown] == [
        ("/map", 2000),
        ("/clock", 2500),
    ]
    stage.playback.seek(2_600 * MS)
    shown = [log.entries[place] for place in stage.taken()]
    assert [(m.topic, m.log_time_ns // MS) for m in shown] == [
        ("/map", 2000),
        ("/clock", 2500),
        ("/clock", 2600),
        ("/a", 2600),
        ("/b", 2600),
    ]
    assert stage.playback.position_ns == 2_600 * MS
    assert stage.playback.play() == (None if paused else 100 * MS)
    assert stage.taken() == []


def test_a_loop_begins_again_one_step_after_the_end_without_drift():
    stage = Stage(run_log(10), loop=True)
    begin = stage.now
    stage.run(ms=10_049, late=2 * MS)
    out = [(at, int(message.data)) for at, message in stage.out]
    assert [place for _, place in out] == list(range(31)) * 10 + [0, 1, 2, 3]
    firsts = [at for at, place in out if place == 0]
    late = [round((at - begin) / MS) - 1000 * n for n, at in enumerate(firsts)]
    assert late == [0] + [2] * 10
    assert not stage.playback.done


def test_steps_at_the_end_stop_or_loop():
    stage = Stage(run_log(3), paused=True)
    assert [stage.playback.step() for _ in range(4)] == [True, True, False, False]
    assert not stage.playback.done, "seeking back is still possible"
    stage.playback.pause(False)
    assert stage.playback.play() is None
    assert stage.playback.done
    stage = Stage(run_log(3), paused=True, loop=True)
    stage.taken()
    assert [stage.playback.step() for _ in range(3)] == [True] * 3
    assert stage.taken() == [4, 5, 6, 7, 8, 9, 0, 1, 2, 3]
    assert stage.playback.position_ns == 0


def test_log_times_of_the_wall_clock_lose_no_nanosecond():
    start = 1_800_000_000_123_456_789
    log = Log(("/a", 0), ("/a", 0.000001), ("/a", 0.000003), start_ns=start)
    stage = Stage(log, rate=0.01)
    stage.playback.seek(start)
    begin = stage.now
    stage.out.clear()
    stage.run()
    assert [at - begin for at, _ in stage.out] == [100, 300]
    assert stage.playback.position_ns == start + 3
