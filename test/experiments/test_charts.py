# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of results: what stands where, and what they say of it."""

from itertools import pairwise

import numpy as np
import pytest
from made_up_results import PLAN, made_up, result_of
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure

from sparse_coord_ros.core.runs.measures import MEASURES
from sparse_coord_ros.show.charts import (
    BEST_ASKING,
    LEAST_SPANS,
    STYLES,
    rendered,
)
from sparse_coord_ros.studies.catalogue import NAMES, experiment
from sparse_coord_ros.studies.experiment_figures import (
    MEASURABLE,
    asked_maps,
    figures_of,
    swept_figure,
)

MOST = 16
"""Conditions of an experiment that are drawn: of the first scenarios."""

AS_TEXT = ("-0.1", "-1", "-10", "-100", "-20", "0")
"""Penalties in the order of the names of their files."""


def with_return(name, value, **settings):
    """Return a result of a condition with this return in every run."""
    learner = settings.pop("learner", "coop")
    ones = {measure: [1.0] * PLAN.runs for measure in MEASURES}
    returns = [value + 0.01 * run for run in range(PLAN.runs)]
    return result_of(name, learner, settings, **{**ones, "returns": returns})


def drawn(axes):
    """Return the points of each learner in a panel, by its colour, shape (points, 2)."""
    found = {}
    for container in axes.containers:
        assert isinstance(container, ErrorbarContainer)
        line = container.lines[0]
        found[line.get_color()] = np.column_stack([line.get_xdata(), line.get_ydata()])
    return found


def joined(axes):
    """Return whether lines join the points of the learners of a panel."""
    styles = {container.lines[0].get_linestyle() for container in axes.containers}
    assert len(styles) == 1
    return styles != {"None"}


def test_penalties_stand_in_numeric_order_with_true_distances():
    returns = dict(
        zip(AS_TEXT, (119.0, 118.0, 115.0, 100.0, 112.0, 120.0), strict=True)
    )
    results = [
        with_return("env1", value, penalty=text) for text, value in returns.items()
    ]
    [panel, *_] = swept_figure(results).axes
    [points] = drawn(panel).values()
    assert points[:, 0].tolist() == sorted(float(text) for text in AS_TEXT)
    assert np.all(np.diff(points[:, 1]) > 0), "the return falls with the penalty: no V"
    places = panel.transData.transform([(float(text), 0.0) for text in AS_TEXT])[:, 0]
    order = [AS_TEXT[i] for i in np.argsort(places)]
    assert order == ["0", "-0.1", "-1", "-10", "-20", "-100"], (
        "penalties grow to the right"
    )
    assert joined(panel)
    assert panel.get_xlabel() == "penalty (log scale)"


def test_numbers_of_one_size_stand_on_a_linear_axis():
    results = [with_return("env1", 100.0 + c, ask_cost=c) for c in (10, 0, 0.5, 7, 2)]
    [panel, *_] = swept_figure(results).axes
    [points] = drawn(panel).values()
    assert points.tolist() == sorted(points.tolist())
    assert (panel.get_xscale(), panel.get_xlabel()) == ("linear", "ask_cost")
    left, right = panel.get_xlim()
    assert left < 0 < 10 < right


@pytest.mark.parametrize(
    ("setting", "values", "scale"),
    [
        ("penalty", ("0", "-0.1", "-1", "-10", "-20", "-100"), "symlog"),
        ("ask_cost", ("0", "0.1", "0.2", "10"), "linear"),
        ("steps", ("1000", "10000", "20000", "100000"), "symlog"),
    ],
)
def test_the_kind_of_an_axis_depends_on_the_quantity(setting, values, scale):
    results = [
        with_return("env1", 120.0, **{"penalty": "-20", setting: v}) for v in values
    ]
    figure = swept_figure(results, setting, ["returns", "asks", "miscoordinations"])
    assert {panel.get_xscale() for panel in figure.axes} == {scale}


@pytest.mark.parametrize("measure", MEASURABLE)
def test_no_axis_scales_to_rounding_noise(measure):
    results = []
    for number, penalty in enumerate(("-1", "-2")):
        alike = {each: [2.0 + 1e-10 * number] * PLAN.runs for each in MEASURES}
        fixed = {**alike, "optimum": 2.0}
        one = result_of("env1", "noncoop", {"penalty": penalty}, **fixed)
        vars(one)["shortest_paths"] = one.measures
        results.append(one)
    [panel] = swept_figure(results, "penalty", [measure]).axes
    low, high = panel.get_ylim()
    assert high - low >= LEAST_SPANS[measure] * (1 - 1e-9)
    [points] = drawn(panel).values()
    assert np.all((low <= points[:, 1]) & (points[:, 1] <= high))


def test_a_quantity_has_one_kind_of_axis_in_every_figure():
    results = [with_return("env1", 110.0, penalty=penalty) for penalty in ("0", "-100")]
    [loss, returns] = swept_figure(results, "penalty", ["loss", "returns"]).axes
    assert (loss.get_yscale(), returns.get_yscale()) == ("symlog", "linear")


@pytest.mark.parametrize("name", NAMES)
def test_every_experiment_has_a_figure(name):
    results = [made_up(one) for one in experiment(name).conditions[:MOST]]
    for draw in figures_of(name).values():
        assert draw(results).axes


def test_a_single_run_has_no_error_and_is_drawn_all_the_same():
    one = {measure: [7.0] for measure in MEASURES}
    result = result_of("env1", "coop", {"penalty": "-20"}, **one)
    [panel] = swept_figure([result], "penalty", ["asks"]).axes
    low, high = panel.get_ylim()
    assert low < 7.0 < high


def test_a_map_of_asks_says_its_learner_and_settings():
    settings = {
        "penalty": -100,
        "ask_cost": 2,
        "steps": 5000,
        "epsilon": "constant:0.2",
    }
    result = result_of("env1", "voi", settings)
    said = [text.get_text() for text in asked_maps([result]).axes[0].texts]
    [title] = [text for text in said if "asks a robot" in text]
    assert title.startswith("env1, voi\n")
    assert all(
        f"{name} {value}" in " ".join(title.split()) for name, value in settings.items()
    )


def test_names_are_points_that_no_line_joins():
    shares = ("same", "each:1:0.5", "each:2:0")
    results = [with_return("env1", 100.0, common_reward=share) for share in shares]
    [panel, *_] = swept_figure(results).axes
    assert not joined(panel)
    assert [label.get_text() for label in panel.get_xticklabels()] == list(shares)


def test_a_reference_that_is_known_at_one_place_is_not_drawn_at_others():
    """The best asking team of env1 is known at a cost of 1."""
    results = [
        with_return("env1", 100.0, penalty="-100", ask_cost=cost) for cost in (0, 1, 10)
    ]
    [panel] = swept_figure(results, "ask_cost", ["returns"]).axes
    known = [
        line for line in panel.lines if line.get_color() == STYLES[BEST_ASKING]["color"]
    ]
    assert [(line.get_xdata().tolist(), line.get_marker()) for line in known] == [
        ([1], "_")
    ]


def test_panels_share_the_length_of_the_axis_so_that_small_differences_look_small():
    results = [
        with_return(name, value, penalty=penalty)
        for name, falls in (("env1", (120.0, 30.0)), ("suny", (111.32, 111.30)))
        for penalty, value in zip(("0", "-100"), falls, strict=True)
    ]
    panels = swept_figure(results, "penalty", ["returns"]).axes
    lengths = [high - low for low, high in (axes.get_ylim() for axes in panels)]
    assert lengths[0] == pytest.approx(lengths[1]) and lengths[0] > 80
    panels = swept_figure(results, "penalty", ["miscoordinations"]).axes
    assert panels[0].get_ylim() == panels[1].get_ylim()


def test_figure4_says_what_its_bars_are_and_how_many_runs_it_shows():
    results = [
        with_return(name, value, penalty=penalty, learner="noncoop")
        for name in ("env1", "suny")
        for penalty, value in (("0", 100.0), ("-100", 90.0))
    ]
    figures = {name: draw(results) for name, draw in figures_of("figure4").items()}
    said = figures["figure4"].legends[0].get_title().get_text()
    assert said.startswith(
        f"Bars: one standard error of the mean over {PLAN.runs} learning runs."
    )
    assert len({axes.get_ylim() for axes in figures["figure4"].axes}) == 1
    said = figures["figure4_variance"].legends[0].get_title().get_text()
    assert said.startswith(f"Each point: {PLAN.runs} learning runs.")


@pytest.mark.parametrize("name", ["table1", "table2", "penalty100", "crowd"])
def test_all_bars_are_standard_errors(name):
    scenario = "crowd-2r" if name == "crowd" else "env1"
    for draw in figures_of(name).values():
        figure = draw([result_of(scenario, "coop", {"penalty": -20})])
        said = figure.legends[0].get_title().get_text()
        assert said.startswith("Bars: one standard error of the mean over ")


def test_a_crowd_is_drawn_over_the_number_of_robots():
    results = [
        with_return(f"crowd-{robots}r", value, peers=peers)
        for robots, value in ((2, 100.0), (3, 90.0), (8, 20.0))
        for peers in ("one", "all")
    ]
    figure = figures_of("crowd")["crowd"](results)
    returns, *others = figure.axes
    assert len(others) == 2
    lines = [container.lines[0] for container in returns.containers]
    assert [line.get_xdata().tolist() for line in lines] == [[2, 3, 8]] * 2
    assert returns.get_xlabel() == "robots"


def test_long_names_below_a_panel_do_not_overlap():
    percepts = [f"probability:{p}" for p in (0.25, 0.5, 0.75, 0.9)]
    percepts += ["always", "line_of_sight", "range:1", "range:2"]
    results = [with_return("env1", 100.0, perception=one) for one in percepts]
    figure = swept_figure(results, "perception", ["returns"])
    renderer = FigureCanvasAgg(figure).get_renderer()
    figure.draw(renderer)
    [panel] = figure.axes
    boxes = [label.get_window_extent(renderer) for label in panel.get_xticklabels()]
    assert all(one.x1 < other.x0 for one, other in pairwise(boxes))


def test_a_figure_that_grew_is_laid_out_again():
    figure = Figure(figsize=(4, 2), layout="constrained")
    axes = figure.subplots()
    before = rendered(figure, "svg")
    axes.set_ylabel("a label\nof\nmany\nlines")
    left = axes.get_position().x0
    after = rendered(figure, "svg")
    assert after != before
    assert axes.get_position().x0 > left + 0.05
