# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a film shows, read from its pixels; what `animate` makes and refuses."""

import io
import json
from itertools import pairwise

import numpy as np
from PIL import Image

from sparse_coord_ros.base.palette import (
    ANSWERED,
    DOORWAY_COLOUR,
    FAILED,
    OUTCOME_COLOURS,
    OUTCOME_SIGNS,
    REFUSED,
    ROBOT_COLOURS,
    rgb,
)
from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action
from sparse_coord_ros.core.runs.run import TeamTransition
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.show import film as films
from sparse_coord_ros.show.episodes import Episode
from sparse_coord_ros.show.film import film
from sparse_coord_ros.show.steps import Question

ENV1 = load_scenario("env1")
[DOOR] = ENV1.map.doorways


def episode(cells, questions=(), met=False):
    """Return an episode; questions are those of its first step, robots meet in its last one."""
    still = [Action(0, False, -1, False)] * len(cells[0])
    asking = list(still)
    ends = [None] * len(still)
    for k, peers, end, move in questions:
        peer = peers[0] if len(peers) == 1 else -1
        asking[k] = Action(move, True, peer, end == wire.PerceptEnd.ANSWERED)
        ends[k] = end
    steps = [
        TeamTransition(
            t, tuple(before), tuple(still), tuple(after), miscoordination=False
        )
        for t, (before, after) in enumerate(pairwise(cells))
    ]
    steps[0] = steps[0]._replace(actions=tuple(asking), ends=ends)
    steps[-1] = steps[-1]._replace(miscoordination=met)
    return Episode(0, True, tuple(steps), arrived=False)


def frames(data):
    image = Image.open(io.BytesIO(data))
    found = []
    for number in range(image.n_frames):
        image.seek(number)
        found.append(
            (np.asarray(image.convert("RGB")).astype(int), image.info["duration"])
        )
    return found


def near(picture, colour, tolerance=10):
    """Return where a picture has a colour."""
    return (np.abs(picture - np.array(rgb(colour)) * 255) <= tolerance).all(axis=-1)


def test_robots_move_from_cell_to_cell():
    [(west, _), *_, (east, last)] = frames(
        film(ENV1, episode([[0, 3], [1, 3]]), title="t")
    )
    blue, orange = (np.argwhere(near(one, ROBOT_COLOURS[0])) for one in (west, east))
    assert (
        20 < (orange - orange.min(axis=0)).mean()
        and orange[:, 1].mean() > blue[:, 1].mean()
    )
    assert last > 2000  # the last frame stands still
    moving = episode([[0, 3], [1, 3], [1, 7], [1, 7]])
    made = film(ENV1, moving, title="t")
    assert sum(ms for _, ms in frames(made)) == 3 * 510 + 2000
    assert made == film(ENV1, moving, title="t")


def test_outcomes_differ_in_colour_line_and_sign():
    made = {}
    [(quiet, _), *_] = frames(film(ENV1, episode([[9, 11], [10, 11]]), title="t"))
    for end in (
        wire.PerceptEnd.ANSWERED,
        wire.PerceptEnd.REFUSED,
        wire.PerceptEnd.LATE,
    ):
        outcome = Question(0, (1,), end, 1).outcome
        asking = episode([[9, 11], [10, 11]], [Question(0, (1,), end, 1)])
        [(picture, stands), *_] = frames(film(ENV1, asking, title="t"))
        colour = OUTCOME_COLOURS[outcome]
        made[outcome] = near(picture, colour).sum() - near(quiet, colour).sum()
        assert stands == 800
    assert made[ANSWERED] > made[REFUSED] > made[FAILED] > 50  # ever less of a line
    assert (
        len(set(OUTCOME_SIGNS.values())) == len(set(films.OUTCOME_LINES.values())) == 3
    )


def test_robots_that_ask_each_other_have_a_sign_each():
    answered = wire.PerceptEnd.ANSWERED
    one = Question(0, (1,), answered, 1)
    rings = []
    for questions in ([one], [one, Question(1, (0,), answered, 1)]):
        asking = episode([[9, 11], [10, 11]], questions)
        [(picture, _), *_] = frames(film(ENV1, asking, title="t"))
        green = near(picture, OUTCOME_COLOURS[ANSWERED])
        rings.append((green.any(axis=1)).sum())
    assert rings[1] > 1.5 * rings[0]  # one above the line, one below


def test_a_miscoordination_is_marked():
    cells = [[9, 11], [DOOR, DOOR]]
    made = (film(ENV1, episode(cells, met=met), title="t") for met in (False, True))
    films = [[picture for picture, _ in frames(data)] for data in made]
    sentence = 20  # pixels of the line below the map that names the robots
    above = len(films[0][0]) - 3 * sentence
    assert len(films[1][0]) == len(films[0][0]) + sentence
    # only when they are there
    assert np.array_equal(films[0][0][:above], films[1][0][:above])
    pictures = [one[-1] for one in films]
    quiet, marked = (near(one, DOORWAY_COLOUR).sum() for one in pictures)
    assert marked > 1.5 * quiet
    assert all(near(pictures[1], colour).sum() > 100 for colour in ROBOT_COLOURS[:2])


def test_many_questions_are_told_in_few_words_and_hide_no_robot():
    crowd = load_scenario("crowd-8r")
    asks = [
        Question(k, tuple(set(range(8)) - {k}), wire.PerceptEnd.REFUSED, 0)
        for k in range(6)
    ]
    places = [35, 36, 37, 38, 39, 40, 57, 20]  # a throng round the doorways
    pictures = films.EpisodePictures(crowd, episode([places] * 2, asks), "a $x$ & <b>")
    quiet, asking = (
        np.asarray(pictures.at(0, 0.0, speaking=speaking).convert("RGB")).astype(int)
        for speaking in (False, True)
    )
    assert pictures.caption.get_text().split("\n") == [
        "step 0 of 1",
        "robot_1 asks all others: refused, goes north",
        "robot_2 asks all others: refused, goes north",
        "and 4 more",
    ]
    alone = Question(0, (), wire.PerceptEnd.NOBODY_TO_ASK, 2)
    assert alone.in_words(["a"]) == "a asks no peer: no answer, goes east"
    for colour in ROBOT_COLOURS:
        assert near(asking, colour).sum() > 0.6 * near(quiet, colour).sum()


def test_a_state_that_the_log_lacks_and_long_episodes(monkeypatch):
    monkeypatch.setattr(films, "MOST_STEPS", 8)
    monkeypatch.setattr(films, "SMOOTH_STEPS", 5)
    lost = episode([[0, None], [1, 3]], [Question(0, (1,), wire.PerceptEnd.LATE, 2)])
    assert len(frames(film(ENV1, lost, title="t"))) == 4
    long = frames(film(ENV1, episode([[0, 3]] * 12), title="t", rate=20))
    assert sum(ms for _, ms in long) == 8 * 50 + 200


def test_every_colour_is_in_the_palette():
    palette = np.array(films.film_palette().getpalette()).reshape(-1, 3)
    for colour in (
        *ROBOT_COLOURS,
        *OUTCOME_COLOURS.values(),
        DOORWAY_COLOUR,
    ):
        assert np.abs(palette - np.array(rgb(colour)) * 255).max(axis=1).min() <= 1


def test_animate_a_bag_and_a_run_without_one(
    bag, trained, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(films, "MOST_STEPS", 5)
    for source, greedy in ((bag, False), (trained, True)):
        out = tmp_path / f"{source.name}.gif"
        arguments = [
            "animate",
            str(source),
            "--episode",
            "best",
            "--out",
            str(out),
            "--json",
        ]
        assert main(arguments) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["greedy"] is greedy and told["arrived"] and 7 < told["steps"] < 100
        assert out.read_bytes().startswith(b"GIF89a")


def test_bad_input_is_one_line(bag, trained, results, tmp_path, capsys):
    out = tmp_path / "x.gif"
    for arguments, words in (
        ([bag, "--episode", "first"], "give the number of an episode"),
        ([trained, "--rate", "0"], "rate"),
        ([results], "holds results, not a run"),
        ([trained, "--episode", "100"], "allowed: 0 to 99"),
    ):
        assert main(["animate", *map(str, arguments), "--out", str(out)]) == 2
        error = capsys.readouterr().err.splitlines()[-1]
        assert error.startswith("error: ") and words in error and not out.exists()
