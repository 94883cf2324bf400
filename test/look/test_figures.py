# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the pictures show, read from the figures' own artists; what `plot` writes and refuses."""

import json
import re
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from made_up_results import PLAN, made_up
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.patches import Circle
from matplotlib.quiver import Quiver
from recordings import chunks_in

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.base.palette import ROBOT_COLOURS
from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.lab.driving.trials import Moment
from sparse_coord_ros.show import figures
from sparse_coord_ros.show.paths import paths_figure
from sparse_coord_ros.show.policy import entered, policy_of
from sparse_coord_ros.show.sources import open_run
from sparse_coord_ros.studies.conditions import make_condition
from sparse_coord_ros.studies.experiment_figures import results_figure
from sparse_coord_ros.studies.store import open_results


def all_axes(figure):
    """Return the panels; what is left of a line is an axes that is off."""
    return [one for part in figure.subfigs for one in part.axes if one.axison]


def test_arrows_and_rings_are_the_policy(trained):
    shown = open_run(trained)
    [axes, *_] = all_axes(figures.runs_figure([shown], ["policy"]))
    policies = [
        policy_of(t, r.goal)
        for t, r in zip(shown.tables, shown.config.scenario.robots, strict=True)
    ]
    arrows = [one for one in axes.collections if isinstance(one, Quiver)]
    assert sum(one.N for one in arrows) == sum(p.moves.sum() for p in policies)
    rings = [one for one in axes.patches if isinstance(one, Circle)]
    assert len(rings) == sum(p.asks.sum() for p in policies)
    vivid = sum((one.get_alpha() == 1).sum() for one in arrows)
    scenario = shown.config.scenario
    reached = [
        entered(policy, scenario.map, robot.start)
        for policy, robot in zip(policies, scenario.robots, strict=True)
    ]
    assert vivid == sum(
        p.moves[r].sum() for p, r in zip(policies, reached, strict=True)
    )
    full = [one for one in arrows if (one.get_facecolor()[0, :3] < 1).any()]
    # the second robot's are hollow
    assert sum(one.N for one in full) == policies[0].moves.sum()
    faces = [one.get_facecolor() for one in axes.get_legend().get_patches()]
    assert [face == (1, 1, 1, 1) for face in faces] == [False, True]


def test_curves_are_the_history(trained):
    shown = open_run(trained)
    figure = figures.runs_figure([shown], ["curves"])
    length, _, asks = all_axes(figure)
    dots, mean = length.lines
    np.testing.assert_array_equal(dots.get_ydata(), shown.history.length)
    window = int(mean.get_label().removeprefix("mean of ").removesuffix(" episodes"))
    np.testing.assert_array_equal(
        mean.get_ydata(), shown.history.curve("length", window)[1]
    )
    assert [line.get_label() for line in asks.lines] == ["robot_1", "robot_2"]
    assert len({line.get_linestyle() for line in asks.lines}) == 2


def test_lines_of_runs_have_no_robot_s_colour(trained, bag):
    """Only lines of robots do."""
    runs = [open_run(trained), open_run(bag)]
    for shown, robots in ((runs, False), (runs[:1], True)):
        *_, asks = all_axes(figures.runs_figure(shown, ["curves"]))
        colours = {line.get_color() for line in asks.lines}
        assert (colours <= set(ROBOT_COLOURS)) == robots
        assert bool(colours & set(ROBOT_COLOURS)) == robots


SHAPES = {
    "wide": ("voi", [".....#.....", ".....D.....", ".....#....."]),
    "very wide": ("coop", ["." * 20 + sign + "." * 19 for sign in "#D#"]),
    "tall": ("coop", [*["..."] * 5, "#D#", *["..."] * 5]),
    "very tall": ("voi", [*["..."] * 20, "#D#", *["..."] * 19]),
}


@pytest.mark.long
@pytest.mark.parametrize("shape", SHAPES)
def test_nothing_overlaps_on_wide_and_tall_maps(shape, tmp_path):
    """Titles, labels, legends, maps, scales and curves of the whole figure."""
    learner, rows = SHAPES[shape]
    ends = [(0, 0), (len(rows) - 1, len(rows[0]) - 1)]
    scenario = {
        "map": {"name": "shape", "text": "title: shape\n---\n" + "\n".join(rows)},
        "robots": {
            "robot_1": {"start": [*ends[0]], "goal": [*ends[1]]},
            "robot_2": {"start": [*ends[1]], "goal": [*ends[0]]},
        },
    }
    file = tmp_path / f"a-building-whose-name-is-long-{len(rows)}.yaml"
    file.write_text(json.dumps(scenario))
    run = tmp_path / "run"
    settings = ["--steps", "300", "--learner", learner, "--out", str(run)]
    assert main(["train", str(file), *settings]) == 0
    shown = open_run(run)
    figure = figures.runs_figure([shown], figures.available(shown))
    FigureCanvasAgg(figure).draw()
    boxes = []
    for axes in all_axes(figure):
        drawn = [axes, *axes.child_axes]
        boxes += [one.bbox for one in drawn]
        boxes += [axes.title.get_window_extent()] * bool(axes.get_title())
        for one in drawn:
            for axis in (one.xaxis, one.yaxis):
                texts = [axis.label, *axis.get_ticklabels()]
                box = axis.get_tightbbox() if any(t.get_text() for t in texts) else None
                boxes += [] if box is None else [box]
        legend = axes.get_legend()
        if legend is not None and not axes.lines:  # of a map, below it
            boxes.append(legend.get_window_extent())
    whole = figure.bbox.padded(1)
    for k, one in enumerate(boxes):
        assert whole.x0 <= one.x0 <= one.x1 <= whole.x1
        assert whole.y0 <= one.y0 <= one.y1 <= whole.y1
        for other in boxes[:k]:
            wide = min(one.x1, other.x1) - max(one.x0, other.x0)
            high = min(one.y1, other.y1) - max(one.y0, other.y0)
            assert min(wide, high) < 2.0  # pixels


def test_long_curves_are_thinned():
    steps, values = figures.thinned(np.arange(5000), np.arange(5000.0))
    assert len(steps) <= figures.MOST_POINTS and steps[0] == 0 and values[-1] == 4999


def test_runs_side_by_side_under_names_that_are_no_formulas(trained, bag, tmp_path):
    place = tmp_path / "$x_{$_$y$" / "bag"
    shutil.copytree(bag, place)
    runs = [open_run(trained), open_run(place)]
    figure = figures.runs_figure(runs, ["policy", "curves"])
    figure.canvas.draw()
    axes = all_axes(figure)
    names = ["trained", r"\$x_{\$_\$y\$"]
    assert [one.get_title() for one in axes[:2]] == [
        f"{name}: greedy moves" for name in names
    ]
    assert [line.get_label() for one in axes for line in one.lines] == 3 * names
    assert figures.names_of([runs[0], runs[0]]) == [str(trained)] * 2


def test_what_a_source_has(trained, bag):
    every = ["policy", "curves"]
    assert figures.parse_whats(None, [open_run(trained)]) == every
    assert figures.parse_whats(None, [open_run(bag)]) == every
    with pytest.raises(SettingError, match=r"--what 'polcy': .*did you mean 'policy'"):
        figures.parse_whats("curves,polcy", [])


def test_the_pictures_of_results(results, tmp_path):
    with pytest.raises(SettingError, match="these results have conditions, asks"):
        results_figure(results, "table1")
    assert results_figure(results)[0] == "conditions"
    out = tmp_path / "r.png"
    assert (
        main(["plot", str(results), "--what", "asks", "--dpi", "30", "--out", str(out)])
        == 0
    )
    assert out.read_bytes().startswith(b"\x89PNG")


def test_the_map_of_asks_is_of_the_hardest_penalty_and_says_so(tmp_path, capsys):
    """Not of the last file by its name: that is penalty 0, where a team asks nothing."""
    asked = {
        ("coop", 0): 0.9,
        ("coop", -10): 0.7,
        ("coop", -100): 0.2,
        ("voi", -100): 0.8,
        ("voi", -10): 0.6,
        ("voi", 0): 0.0,
    }
    with open_results(tmp_path / "r", PLAN) as opened:
        for (learner, penalty), asks in asked.items():
            one = make_condition("env1", learner, {"penalty": penalty})
            opened.save(one, made_up(one, asks=[asks] * PLAN.runs))
    out = tmp_path / "r.svg"
    command = ["plot", str(tmp_path / "r"), "--what", "asks", "--out", str(out)]
    assert main(command) == 0
    assert (
        "asks: env1/voi/penalty=-100, where robots ask most" in capsys.readouterr().err
    )
    [axes, _] = results_figure(tmp_path / "r", "asks")[1].axes
    assert "env1, voi\npenalty -100\n0.800 asks a robot" in [
        t.get_text() for t in axes.texts
    ]


@pytest.mark.parametrize(("ending", "begins"), [("svg", b"<?xml"), ("PDF", b"%PDF")])
def test_plot_writes_the_same_bytes_each_time(
    trained, tmp_path, capsys, ending, begins
):
    files = [tmp_path / f"{n}.{ending}" for n in "ab"]
    for file in files:
        assert (
            main(
                ["plot", str(trained), "--what", "curves", "--out", str(file), "--json"]
            )
            == 0
        )
        said = json.loads(capsys.readouterr().out)
        assert said == {
            "file": str(file),
            "bytes": file.stat().st_size,
            "what": "curves",
        }
    assert files[0].read_bytes() == files[1].read_bytes()
    assert files[0].read_bytes().startswith(begins)


def test_each_episode_has_a_path_of_its_own():
    run = make_run(load_scenario("env1"), {})
    moments = [Moment(n // 3, 0.1 * n, ((n, 0.0), (0.0, n))) for n in range(6)]
    touches = [SimpleNamespace(place=(1.0, 1.0))]
    team = SimpleNamespace(path=moments, simulator=SimpleNamespace(touches=touches))
    figure = paths_figure(run, SimpleNamespace(team=team))
    lines = [line.get_xydata().tolist() for line in figure.axes[0].lines]
    own = [[[n, 0] for n in range(3)], [[n, 0] for n in range(3, 6)]]
    others = [[[y, x] for x, y in path] for path in own]
    assert lines == [*own, *others, [[1, 1]]]


def said(capsys, *arguments):
    assert main(["plot", *map(str, arguments)]) == 2
    error = capsys.readouterr().err.splitlines()
    assert error[-1].startswith("error: ") and "Traceback" not in "".join(error)
    return error[-1]


def test_bad_input_is_one_line(trained, results, tmp_path, capsys):
    out = tmp_path / "x.png"
    (tmp_path / "d.png").mkdir()
    assert "ends in .png, .svg, .pdf" in said(
        capsys, trained, "--out", tmp_path / "x.gif"
    )
    assert "there is no folder" in said(
        capsys, trained, "--out", tmp_path / "none/x.png"
    )
    assert "cannot be written" in said(capsys, trained, "--out", tmp_path / "d.png")
    assert "--dpi: value is" in said(capsys, trained, "--dpi", "1e9", "--out", out)
    assert "not a bag" in said(capsys, tmp_path, "--out", out)
    assert "alone" in said(capsys, results, trained, "--out", out)
    assert not out.exists()


def test_a_bag_without_its_last_tables_says_of_which_step_they_are(bag, tmp_path):
    [whole] = bag.glob("*.mcap")
    chunks = chunks_in(whole)
    cut = tmp_path / "cut_0.mcap"
    cut.write_bytes(whole.read_bytes()[: chunks[-1][0]])
    for path, said in (
        (bag, []),
        (cut, [r"its newest tables are of step \d+ of \d+: "]),
    ):
        lines = []
        _ = open_run(path, lines.append).tables
        found = [line for line in lines if "tables" in line]
        assert len(found) == len(said)
        assert all(map(re.match, said, found))
