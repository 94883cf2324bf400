# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tables: as Markdown for reading, as CSV in full precision; and how numbers are written."""

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

from sparse_coord_ros.core.evaluation import Measure
from sparse_coord_ros.core.sparse import dense_nbytes
from sparse_coord_ros.engine.report.entries import Entries, Entry
from sparse_coord_ros.engine.results import BY_ROBOT, SUMS

UNITS = ("B", "kB", "MB", "GB", "TB", "PB", "EB", "ZB", "YB")
PAPER_MEASURES = ("reward", "time_to_goal", "miscoordinations")
NOTHING = "-"


@dataclass(frozen=True)
class Table:
    """A table for reading.

    Attributes:
        caption: what it shows, one sentence.
        head: the names of the columns.
        rows: its rows, as texts.
        left: how many columns, from the first on, are aligned to the left.
    """

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    left: int = 2

    def to_markdown(self) -> str:
        """Return caption and table."""
        rule = [":--" if column < self.left else "--:" for column in range(len(self.head))]
        lines = [self.head, rule, *self.rows]
        table = "\n".join("| " + " | ".join(line) + " |" for line in lines)
        return f"{self.caption}\n\n{table}\n"


def pair(measure: Measure | None, digits: int = 2) -> str:
    """Return `mean ± spread`."""
    if measure is None:
        return NOTHING
    return f"{measure.mean:.{digits}f} ± {measure.spread:.{digits}f}"


def with_error(measure: Measure, digits: int = 2) -> str:
    """Return `mean (standard error)`."""
    return f"{measure.mean:.{digits}f} ({measure.standard_error:.{digits}f})"


def signed(measure: Measure, digits: int = 2) -> str:
    """Return `+difference (standard error)`."""
    return f"{measure.mean:+.{digits}f} ({measure.standard_error:.{digits}f})"


def optimum(entry: Entry, digits: int = 2) -> str:
    """Return the joint optimum, marked where it is an upper bound only."""
    value = f"{entry.result.optimum:.{digits}f}"
    return value if entry.result.optimum_exact else f"<= {value}"


def percent(share: float, digits: int = 1) -> str:
    """Return a share in percent."""
    return NOTHING if math.isnan(share) else f"{100 * share:.{digits}f} %"


def size(count: float) -> str:
    """Return a number of bytes in decimal units, e.g. 14.1 kB."""
    power = 0
    while count >= 1000 and power < len(UNITS) - 1:
        count /= 1000
        power += 1
    return f"{count:.0f} {UNITS[0]}" if power == 0 else f"{count:.1f} {UNITS[power]}"


def dense_bytes(entry: Entry) -> int:
    """Return the bytes of one robot's Q^C with a row for every joint state."""
    return dense_nbytes(len(entry.scenario.map.cells), entry.scenario.perceived)


def listed(texts: Sequence[str]) -> str:
    """Return texts as an enumeration; "none" where there are none."""
    if len(texts) < 2:
        return texts[0] if texts else "none"
    return f"{', '.join(texts[:-1])} and {texts[-1]}"


def exceptions(texts: Sequence[str]) -> str:
    """Return what a sentence ends with that counts cases: the others, where there are any."""
    return f"; not in: {listed(texts)}." if texts else "."


def cell_row(entry: Entry) -> dict[str, object]:
    """Return everything about one cell, for a row of a CSV file."""
    result, scenario = entry.result, entry.scenario
    row: dict[str, object] = {
        "id": result.id,
        "scenario": entry.name,
        "learner": entry.cell.learner,
        "settings": ",".join(f"{key}={value}" for key, value in entry.cell.settings),
        "penalty": scenario.penalty,
        "steps": scenario.steps,
        "robots": result.robots,
        "runs": result.runs,
        "trials": result.trials,
    }
    for name in SUMS:
        row |= {f"{name}_{key}": value for key, value in asdict(result.measure(name)).items()}
    for name in BY_ROBOT:
        row[f"{name}_by_robot"] = " ".join(map(repr, result.robot_means[name]))
    for name in PAPER_MEASURES:
        paper = entry.paper(name)
        row[f"paper_{name}_mean"] = paper.mean if paper else ""
        row[f"paper_{name}_spread"] = paper.spread if paper else ""
    return row | {
        **{f"shortest_path_{name}": result.reference[name] for name in PAPER_MEASURES},
        "optimum": result.optimum,
        "optimum_exact": result.optimum_exact,
        "arrived": result.arrived,
        "failed_teams": result.failed_teams,
        "joint_states": result.joint_states,
        "visited_share": result.visited_share,
        "visited_bytes": result.visited_bytes,
        "dense_bytes": dense_bytes(entry),
    }


def to_csv(entries: Entries) -> str:
    """Return a CSV file: one row a cell, the same columns for every experiment."""
    rows = [cell_row(entry) for entry in entries]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def behaviour(entries: Entries) -> Table:
    """Return arrival, asks and the sparsity of Q^C."""
    rows = []
    for entry in entries:
        result = entry.result
        coop = entry.cell.learner == "coop"
        rows.append(
            [
                entry.name,
                entry.learner,
                percent(result.arrived, 2),
                f"{result.failed_teams} of {result.runs}",
                with_error(entry.measure("asks"), 3) if coop else NOTHING,
                percent(result.visited_share) if coop else NOTHING,
                size(result.visited_bytes) if coop else NOTHING,
                size(dense_bytes(entry)) if coop else NOTHING,
            ]
        )
    head = ["scenario", "learner", "all arrive", "failed teams", "COORDINATE (s.e.)"]
    return Table(
        "Arrival, use of COORDINATE and sparsity of Q^C. All arrive: share of trials in which "
        "every robot arrives. Failed team: a run in which some robot fails to arrive in more "
        "than one trial of a thousand. COORDINATE: choices per robot and episode. Visited: joint "
        "states that a robot's Q^C has updated while learning, mean over robots; bytes are per "
        "robot, of the visited rows (their keys included where the table is sparse) and of the "
        "dense table.",
        [*head, "visited", "bytes visited", "bytes dense"],
        rows,
    )
