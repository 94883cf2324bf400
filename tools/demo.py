# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`make demo`: two learners, the same doorway, on one screen.

python -m tools.demo OUT

Two teams learn live over ROS 2, into OUT and OUT_voi. Then it says whether they learned, how good
they are, what it cost, and what to try next. Where a person sits at a terminal beside a browser,
a page opens that plays both teams; Ctrl-C ends it.
"""

import argparse
import json
import os
import subprocess
import sys
import webbrowser
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

LEARNERS = {"coop": "the paper's learner", "voi": "ours"}
SEED = 1
STEPS = 20_000

STORY = """\
Two robots change rooms through one doorway, D. If both are in it at once, each pays 100:
a miscoordination. A robot may ask where the other one is; a question costs 1.
"""


def main() -> None:
    """Run the demo."""
    parser = argparse.ArgumentParser(prog="python -m tools.demo", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("out", metavar="OUT")
    parser.add_argument("--steps", type=int, default=STEPS)
    options = parser.parse_args()
    runs = {"coop": options.out, "voi": f"{options.out}_voi"}
    print(STORY)
    print(sparse_coord("maps", "env1").split("\n\n")[1], end="\n\n")
    summaries = {
        learner: learn(learner, out, options.steps) for learner, out in runs.items()
    }
    facts = json.loads(sparse_coord("evaluate", *runs.values(), "--json"))["runs"]
    values = dict(zip(runs, facts, strict=True))
    print("", *answers(values, summaries), "", *next_commands(runs), sep="\n")
    terminal = sys.stdin.isatty() and sys.stdout.isatty()
    if can_open(os.environ, terminal=terminal):
        print("\nBoth open in the browser now; Ctrl-C ends.")
        watch = [program(), "watch", *runs.values(), "--port", "0", "--browser"]
        with suppress(KeyboardInterrupt):
            subprocess.run(watch, check=True)


def program() -> str:
    """Return the path of the command `sparse_coord`."""
    return str(Path(sys.executable).with_name("sparse_coord"))


def sparse_coord(*words: str) -> str:
    """Run a verb; return what it prints."""
    done = subprocess.run([program(), *words], stdout=subprocess.PIPE, text=True)
    if done.returncode:  # it has said why
        sys.exit(done.returncode)
    return done.stdout


def learn(learner: str, out: str, steps: int) -> dict[str, Any]:
    """Let a team learn; return its summary."""
    words = ["run", "env1", "--learner", learner]
    words += ["--steps", str(steps), "--seed", str(SEED), "--out", out]
    print("sparse_coord", *words, flush=True)
    return json.loads(sparse_coord(*words, "--json"))


def answers(
    values: Mapping[str, Mapping[str, Any]], summaries: Mapping[str, Mapping[str, Any]]
) -> list[str]:
    """Return whether teams learned, how good they are, and what it cost.

    Args:
        values: what `evaluate --json` says, by learner.
        summaries: what `run --json` says, by learner.
    """
    lines = [
        f"{'':<25} {'return':>7} {'miscoordinations':>17} {'questions':>10} {'moves':>6}"
    ]
    for learner, team in values.items():
        lines.append(_row(f"{learner}, {LEARNERS[learner]}", team))
    first = next(iter(values.values()))
    lines.append(_row("shortest paths, no asking", first["shortest_paths"]))
    least = first["shortest_paths"]["returns"]
    most = first["optimum"]
    lines += ["", "Did they learn?"]
    for learner, team in values.items():
        lines.append(f"  {learner}: {team['verdict']['text'].split('. ')[0]}.")
    lines += [
        "How good is that?",
        f"  Robots that ignore each other get {least:.2f}. Nobody can get more than "
        f"{most:.2f}: one mind that sees both robots for free.",
        "What did it cost?",
    ]
    for learner, summary in summaries.items():
        asked = sum(robot["answered"] for robot in summary["asks"].values())
        lines.append(
            f"  {learner}: {summary['transitions']:,} steps in {summary['seconds']:.0f} s, "
            f"{summary['miscoordinations']} miscoordinations and {asked:,} questions on the way."
        )
    return lines


def _row(name: str, team: Mapping[str, Any]) -> str:
    return (
        f"{name:<25} {team['returns']:7.2f} {team['miscoordinations']:17.2f} "
        f"{team['asks']:10.2f} {team['time_to_goal']:6.2f}"
    )


def next_commands(runs: Mapping[str, str]) -> list[str]:
    """Return what to try next: lines that work as typed."""
    command = os.path.relpath(program())
    first, second = runs.values()
    tries = {
        f"watch {first} {second} --browser": "both teams, by one clock",
        f"explain {first}/bag --step 100": "what each question changed",
        "train pentagon --steps 100000 --out runs/pentagon": "another building",
        "--help": "everything else",
    }
    width = max(map(len, tries)) + 2
    return ["What next?"] + [
        f"  {command} {words:<{width}} # {what}" for words, what in tries.items()
    ]


def can_open(environment: Mapping[str, str], *, terminal: bool) -> bool:
    """Return whether a page can be opened in a browser that a person sees.

    Args:
        environment: the environment variables.
        terminal: whether input and output are a terminal.
    """
    shown = "DISPLAY" in environment or "WAYLAND_DISPLAY" in environment
    if not terminal or (sys.platform == "linux" and not shown):
        return False
    try:
        webbrowser.get()
    except webbrowser.Error:
        return False
    return True


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit(130)
