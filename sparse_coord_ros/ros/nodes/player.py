# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The player node: replays a recorded run on its topics, with its types, QoS and clock."""

import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Unpack

from rclpy.parameter import Parameter

from sparse_coord_ros.base.errors import RunError, SettingError
from sparse_coord_ros.core.game.settings import SettingTable
from sparse_coord_ros.log.bags.playback import Playback
from sparse_coord_ros.log.bags.playlist import Playlist
from sparse_coord_ros.protocol.wire import services
from sparse_coord_ros.protocol.wire.messages import SECOND
from sparse_coord_ros.ros.nodes.parameters import PARAMETERS, NodePlace, ParameterNode
from sparse_coord_ros.ros.nodes.player_keys import Keyboard
from sparse_coord_ros.ros.nodes.player_topics import PlayedTopics
from sparse_coord_ros.ros.nodes.spin import run_node, wait_for_readers

KEYS_SECONDS = 0.05
TURN_NS = 100_000
"""The timer's shortest wait, so that services and keys have their turn when messages are late."""
SEEK_SECONDS = 10.0
LONGEST_WAIT_NS = 60 * SECOND
"""The timer's longest wait, as its type cannot hold every distance of log times; longer waits
repeat it."""

KEYS_HELP = (
    "space: pause or resume, right: next time step, left or Page Up: 10 s back, Page Down: 10 s "
    "on, up/down: twice or half the rate, Home: start, q: quit"
)
REMEDY = "seek back: parameter position, keys left or Home"


class Player(ParameterNode):
    """Publishes the raw messages of a bag at the distances of their log times.

    Args:
        keyboard: listen to the terminal's keys, if there is one.
        place: where the node is made, and with what: see `NodePlace`. The topics have their
            recorded names in any namespace.

    Attributes:
        delay: the seconds that it waits for subscribers before playing begins.
        played: the topics that it publishes.
        begun: whether it has reached the place where playing begins.
        done: whether the bag is at its end, or the user quits.

    Raises:
        SparseCoordError: a bad parameter, or no topic to play.
    """

    changeable = ("rate", "position")
    delay = 0.5

    def __init__(self, *, keyboard: bool = False, **place: Unpack[NodePlace]) -> None:
        self.begun = False
        super().__init__("player", PARAMETERS["player"], **place)
        self.offer(services.PAUSE, self._pause)
        self.offer(services.STEP, self._step)
        self.add_post_set_parameters_callback(self.guarded(self._on_change))
        self._timer = self.create_timer(self.delay, self._tick)
        keys = Keyboard()
        if keyboard and keys.there:
            # restores the terminal in any case
            self.at_end.callback(keys.close)
            self.create_timer(KEYS_SECONDS, lambda: self._on_keys(keys))
            self.get_logger().info(KEYS_HELP)

    def set_up(self) -> None:
        """Open the bag, advertise its topics and index its messages."""
        values = self.values
        if not values["bag"]:
            raise SettingError(
                "parameter bag: none is given; start the node with --ros-args -p bag:=DIRECTORY"
            )
        played = self.played = PlayedTopics(self, Path(values["bag"]))
        playlist = Playlist(played.bag, played.publishers, played.kept)
        self._start_ns = played.bag.start_ns
        self._seconds = (playlist.end_ns - self._start_ns) / SECOND
        last = replace(self._table["position"], high=self._seconds)
        self._table = SettingTable([*self._table.values(), last])
        self.parse(self._table, {"position": values["position"]})
        how: dict[str, Any] = {
            "rate": values["rate"],
            "loop": values["loop"],
            "paused": values["start_paused"],
        }
        publish = played.publish
        now = time.monotonic_ns
        if not values["wait"]:
            how["on_gap"] = self._on_gap
        self._playback = Playback(playlist, publish, now, on_time=played.tell, **how)
        self.get_logger().info(
            f"{played.bag.path}: {len(playlist)} messages on {len(played.publishers)} topics, "
            f"{playlist.step_count} time steps, {self._seconds:g} s"
        )

    @property
    def _position(self) -> float:
        """Seconds from the bag's first message to the current log time."""
        if not self.begun:
            return self.values["position"]
        return (self._playback.position_ns - self._start_ns) / SECOND

    def _tick(self) -> None:
        if not self.begun:
            self._begin()
        wait_ns = self._playback.play()
        if wait_ns is None:
            self._timer.cancel()
            self.done = self.done or self._playback.done
        else:
            self._timer.timer_period_ns = max(TURN_NS, min(wait_ns, LONGEST_WAIT_NS))
            self._timer.reset()

    def _begin(self) -> None:
        """Go to the place where playing begins, after subscribers had time to come."""
        self.begun = True
        if self.count_publishers(self.played.clock_name) > 1:
            raise RunError(
                f"another node publishes {self.played.clock_name}: this player would disturb a "
                "live run or another player; use another ROS_DOMAIN_ID"
            )
        self._seek(self.values["position"])

    def _seek(self, seconds: float) -> None:
        self._playback.seek(
            self._start_ns + round(min(seconds, self._seconds) * SECOND)
        )

    def _on_gap(self, begin_ns: int, end_ns: int) -> None:
        begin = (begin_ns - self._start_ns) / SECOND
        seconds = (end_ns - begin_ns) / SECOND
        self.get_logger().info(
            f"no messages for {seconds:.1f} s after {begin:.3f} s: jumped; "
            "to wait: replay --wait, or parameter wait"
        )

    def _wake(self) -> None:
        """Let the timer fire at once."""
        if self.begun:
            self._timer.timer_period_ns = 1
            self._timer.reset()

    def _pause(self, hold: bool) -> tuple[bool, str]:
        self._playback.pause(hold)
        self._wake()
        return True, self._state()

    def _step(self) -> tuple[bool, str]:
        """Play the next time step; return whether there was one, and a text."""
        self._playback.pause(True)
        before = self._playback.published
        if not self.begun:
            self._begin()
        elif not self._playback.step():
            return False, f"the bag has ended at {self._position:.3f} s; {REMEDY}"
        count = self._playback.published - before
        what = "message" if count == 1 else "messages"
        return True, f"{self._state()}: {count} {what}"

    def _state(self) -> str:
        doing = (
            "paused"
            if self._playback.paused
            else f"playing at rate {self.values['rate']:g}"
        )
        return f"{doing} at {self._position:.3f} s"

    def _on_change(self, parameters: list[Parameter]) -> None:
        """Apply changed parameters."""
        for parameter in parameters:
            if parameter.name == "rate":
                self._playback.set_rate(self.values["rate"])
            elif parameter.name == "position" and self.begun:
                self._seek(self.values["position"])
        self._wake()

    def _on_keys(self, keys: Keyboard) -> None:
        for key in keys.read():
            if key == "quit":
                self.done = True
            else:
                self.get_logger().info(
                    self._step()[1] if key == "step" else self._on_key(key)
                )

    def _on_key(self, key: str) -> str:
        """Handle a key, and return a text for the log."""
        if key == "pause":
            return self._pause(not self._playback.paused)[1]
        rate = self.values["rate"]
        at = self._position
        limits = PARAMETERS["player"]["rate"]
        name, value = {
            "start": ("position", 0.0),
            "back": ("position", max(0.0, at - SEEK_SECONDS)),
            "on": ("position", min(self._seconds, at + SEEK_SECONDS)),
            "faster": ("rate", min(limits.high, 2 * rate)),
            "slower": ("rate", max(limits.low, rate / 2)),
        }[key]
        self.set_parameters([Parameter(name, value=value)])
        return f"{self._state()}, rate {value:g}" if name == "rate" else self._state()

    def finish(self, *, interrupted: bool) -> None:
        """Log how well the times were kept; at the end of the bag wait for the readers."""
        late = self._playback.late_ns
        kept = "" if late is None else f", at most {late / 1e6:.2f} ms late"
        self.get_logger().info(
            f"{'stopped' if interrupted else 'ended'} at {self._position:.3f} s, "
            f"{self._playback.published} messages published{kept}"
        )
        if self._playback.done:
            wait_for_readers(self.played.publishers.values())


def main() -> int:
    """Run the node `player`."""
    return run_node(lambda context: Player(context=context, keyboard=True))
