# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of results: those of the report, and one of whatever conditions there are."""

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from sparse_coord_ros.errors import ResultsError, SettingError, did_you_mean
from sparse_coord_ros.experiments.catalogue import NAMES, experiment
from sparse_coord_ros.experiments.report.drawings import figures_of
from sparse_coord_ros.experiments.report.map_pictures import asked_maps
from sparse_coord_ros.experiments.store import ConditionResult, read_results

VARIANCE = "_variance"


def results_figure(
    directory: Path, what: str | None = None, say: Callable[[str], None] = lambda _: None
) -> tuple[str, Figure]:
    """Draw something of a results directory.

    Args:
        directory: where it is.
        what: `conditions`, every one; `asks`, a map a scenario in which robots may ask; an
            experiment that is complete, or one of its figures; None: the first of these.
        say: hears what is left out.

    Returns:
        What is drawn, and the figure.

    Raises:
        ResultsError: it is no results directory, or holds no result yet, or a broken one.
        SettingError: there is no such thing to draw.
    """
    _, results = read_results(directory, say)
    if not results:
        remedy = "'sparse_coord reproduce' puts some there"
        raise ResultsError(f"{directory}: holds no result yet; {remedy}")
    by_id = {one.id: one for one in results}
    drawn: dict[str, list[ConditionResult]] = {"conditions": list(results)}
    for name in NAMES:
        ids = [condition.id for condition in experiment(name).conditions]
        if by_id.keys() >= set(ids):
            drawn[name] = [by_id[one] for one in ids]
    if "figure4" in drawn:
        drawn[f"figure4{VARIANCE}"] = drawn["figure4"]
    asking = {one.scenario.name: one for one in results if one.learner.asks}
    if asking:
        drawn["asks"] = list(asking.values())
    what = what or "conditions"
    if what not in drawn:
        why = f"these results have {', '.join(drawn)}{did_you_mean(what, drawn)}"
        raise SettingError(f"--what {what!r}: {why}")
    if what == "asks":
        return what, asked_maps(drawn[what])
    return what, figures_of(what.removesuffix(VARIANCE), drawn[what])[what]
