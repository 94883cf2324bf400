# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Do two processes find each other over ROS 2 and hear each other?

Two children are started (`python -m sparse_coord_ros.ros.doctor.round_trip echo NAME`, and `ask`):
a crash or a hang in the middleware is then a finding, and does not end the doctor.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from sparse_coord_ros.ros.doctor.checks import FINE, HINT, WRONG, Finding
from sparse_coord_ros.ros.nodes.environment import (
    PEERS,
    PROFILES,
    PROFILES_3,
    RANGE,
    SECURITY,
)

SECONDS = 8.0
"""How long the asker waits for an answer."""

START_SECONDS = 20.0
"""How long the import of rclpy may take in addition, on a slow machine."""

GRACE_SECONDS = 5.0
"""How long a process may take to end."""

TESTED_MIDDLEWARE = "rmw_fastrtps_cpp"
"""The middleware that this package is tested with."""

SUSPECTS = (
    *("RMW_IMPLEMENTATION", SECURITY, "ROS_DISCOVERY_SERVER"),
    *(PROFILES, PROFILES_3),
)
"""Variables whose wrong values prevent ROS from starting, or nodes from connecting."""


def findings() -> Iterator[Finding]:
    """Try rclpy, the middleware, and a round trip between two processes."""
    answers = round_trip()
    if "missing" in answers:
        text = f"is not there ({answers['missing']}): all works except run, replay and live watch"
        remedy = "source /opt/ros/jazzy/setup.bash, or pip install '.[ros]'"
        yield Finding(HINT, "ROS 2", text, remedy)
        return
    if "rmw" in answers:
        known = answers["rmw"] == TESTED_MIDDLEWARE
        remedy = (
            ""
            if known
            else f"export RMW_IMPLEMENTATION={TESTED_MIDDLEWARE}, which was tested"
        )
        yield Finding(
            FINE if known else HINT, "ROS 2", f"rclpy with {answers['rmw']}", remedy
        )
    if "round_trip" in answers:
        yield _connected(answers)
        return
    text = answers.get(
        "problem", "two processes on this machine do not reach each other"
    )
    remedy = (
        f"see the findings above; unset {', '.join(SUSPECTS)}; stop the firewall to try"
    )
    if "problem" not in answers and os.environ.get(RANGE) != "LOCALHOST":
        if "round_trip" in round_trip({RANGE: "LOCALHOST"}):
            text = "multicast does not work here, or discovery is turned off"
            remedy = f"export {RANGE}=LOCALHOST, or mend it"
    yield Finding(WRONG, "round trip", text, remedy)


def _connected(answers: Mapping[str, Any]) -> Finding:
    """Say how long a round trip took, and by which transport."""
    way = "shared memory" if answers["shared_memory"] else "UDP"
    text = f"two processes exchanged messages by {way} in {answers['round_trip']:.1f} s"
    if not answers["shared_memory"]:
        return Finding(FINE, "round trip", text)
    remedy = (
        f"unset {PROFILES}, {PROFILES_3} and {PEERS}, so that nodes use UDP: with shared memory "
        "one process that stands still slows all"
    )
    return Finding(HINT, "round trip", text, remedy)


def round_trip(changes: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Let one process ask and another answer.

    Args:
        changes: environment variables to change.

    Returns:
        `rmw`; `round_trip`, the seconds until the first answer, if one came; `shared_memory`,
        whether a process of Fast DDS uses it. Or `missing`, why rclpy cannot be imported; or
        `problem`.
    """
    name = f"sparse_coord_doctor_{os.getpid()}"
    env = {**os.environ, **(changes or {})}
    run = [sys.executable, "-P", "-m", __name__]
    pipe = subprocess.PIPE
    echo, asker = (
        subprocess.Popen(
            [*run, role, name], env=env, stdout=pipe, stderr=pipe, text=True
        )
        for role in ("echo", "ask")
    )
    try:
        out, err = asker.communicate(timeout=SECONDS + START_SECONDS)
        lines = err.strip().splitlines()
        with suppress(json.JSONDecodeError, IndexError):
            return dict(json.loads(out.strip().splitlines()[-1]))
        return {
            "problem": lines[-1] if lines else f"a process died ({asker.returncode})"
        }
    except subprocess.TimeoutExpired:
        return {"problem": "the middleware hangs"}
    finally:
        for process in (asker, echo):
            process.terminate()
            try:
                process.communicate(timeout=GRACE_SECONDS)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()


def uses_shared_memory() -> bool:
    """Return whether Fast DDS has mapped shared memory into this process; Linux only."""
    try:
        maps = Path("/proc/self/maps").read_text()
    except OSError:
        return False
    return "/dev/shm/fastrtps_" in maps or "/dev/shm/fastdds_" in maps


def main(role: str, name: str) -> int:
    """Answer until killed, or ask and print the result as JSON."""
    try:
        import rclpy
        from std_msgs.msg import Int64

        from sparse_coord_ros.ros.nodes.spin import ros_context
    except ImportError as error:
        print(json.dumps({"missing": str(error)}))
        return 0
    from rclpy.executors import SingleThreadedExecutor

    stopped: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: stopped.append(number))
    with ros_context() as context:
        node = rclpy.create_node(f"{name}_{role}", context=context)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        asks = role == "ask"
        says, hears = ("question", "answer") if asks else ("answer", "question")
        publisher = node.create_publisher(Int64, f"{name}/{says}", 10)
        heard: list[Any] = []
        then = heard.append if asks else publisher.publish
        node.create_subscription(Int64, f"{name}/{hears}", then, 10)
        began = time.monotonic()
        while not (stopped or heard or (asks and time.monotonic() - began > SECONDS)):
            if asks:
                publisher.publish(Int64(data=1))
            executor.spin_once(timeout_sec=0.05)
        if asks:
            answers: dict[str, Any] = {"rmw": rclpy.get_rmw_implementation_identifier()}
            answers |= {"round_trip": time.monotonic() - began} if heard else {}
            answers["shared_memory"] = uses_shared_memory()
            print(json.dumps(answers), flush=True)
        executor.shutdown()
        node.destroy_node()
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
