# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a run and of results: whole, self-contained, escaped, and true."""

import base64
import re
import shlex
import shutil
from html import unescape
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest
import yaml
from made_up_results import PLAN, made_up
from matplotlib.figure import Figure
from sparse_coord_ros.show.results_report import results_report

from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.engine.training import train
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.tables import tables_equal
from sparse_coord_ros.core.runs.run_config import load_run
from sparse_coord_ros.core.solve.exact import evaluate_exact
from sparse_coord_ros.log.runlog.explain import explained, in_words
from sparse_coord_ros.log.runlog.log import read_run
from sparse_coord_ros.show.html import picture
from sparse_coord_ros.show.report import faults, run_report
from sparse_coord_ros.show.sources import open_run
from sparse_coord_ros.studies.catalogue import experiment
from sparse_coord_ros.studies.store import SUMS, open_results


def tags_of(page):
    """Return the tags of a page that is well-formed and fetches nothing."""
    tags = []
    for element in ElementTree.fromstring(page).iter():
        tags.append(element.tag)
        for name, value in element.items():
            assert not name.startswith("on")
            if name == "href":
                assert value.startswith("#section-")
            if name == "src":
                assert value.startswith("data:image/svg+xml;base64,"), value
                ElementTree.fromstring(base64.b64decode(value.partition(",")[2]))
    return tags


def wrapped(name):
    """Return a condition's name as it stands in a table, with the places where it may break."""
    return name.replace("/", "/<wbr/>").replace(",", ",<wbr/>")


def test_a_page_has_no_markdown_and_its_pictures_have_whole_names(tmp_path):
    """The words of its sections are those of the Markdown pages."""
    folder = tmp_path / "results"
    with open_results(folder, PLAN) as opened:
        for one in experiment("uneven").conditions:
            means = {name: [1.0] * PLAN.runs for name in SUMS}
            opened.save(one, made_up(one, means=means))
    page = results_report(folder)
    assert "`" not in page and "; same: both factors are one" in page
    assert 'alt="r^C that differs between the robots (uneven)"' in page
    caption = "Table 3: the large scenarios (table3). Bars are standard errors."
    assert picture(Figure(), caption)["alt"] == "Table 3: the large scenarios (table3)"


@pytest.fixture
def quick(monkeypatch):
    """Let pages have one picture."""
    monkeypatch.setattr(
        "sparse_coord_ros.show.figures.available", lambda shown: ["policy"]
    )


@pytest.fixture(scope="module")
def page(bag):
    return run_report(open_run(bag))


def test_the_page_of_a_bag_is_whole_and_self_contained(page):
    tags = tags_of(page)
    assert tags.count("img") == 5 and "script" not in tags
    assert page.count("<h2 ") == 6


def test_the_page_is_reached_by_keys_and_names(page):
    """Landmarks, headings in order, named pictures and tables; wide boxes take the focus."""
    tree = ElementTree.fromstring(page.partition("\n")[2])
    headings = tree.findall("body/main/h2")
    links = tree.findall("body/header/nav/a")
    assert [(f"#{one.get('id')}", one.text) for one in headings] == [
        (one.get("href"), one.text) for one in links
    ]
    assert all(one.get("alt") for one in tree.iter("img"))
    boxes = [one for one in tree.iter("div") if one.get("class") == "scroll"]
    inside = {one for box in boxes for one in box}
    pictures = list(tree.iter("img"))
    assert inside == {*tree.iter("table"), *tree.iter("pre"), *pictures}
    least = [
        int(re.search(r"--least: (\d+)px", one.get("style"))[1]) for one in pictures
    ]
    assert max(least) >= 640, "the letters of four panels side by side can be read"
    assert all(box.get("tabindex") == "0" and box.get("aria-label") for box in boxes)
    heads = list(tree.iter("th"))
    assert all(one.get("scope") in ("col", "row") and one.text for one in heads)


def test_its_numbers_are_those_of_the_log(page, bag):
    shown = open_run(bag)
    exact = evaluate_exact(shown.config.scenario, shown.tables, learner="coop")
    assert f"<td>{exact.returns.mean:.2f} ± {exact.returns.spread:.2f}</td>" in page
    for words in (
        "exact joint optimum",
        "121.89",
        "fixed shortest paths",
        "Indiv., same seed",
    ):
        assert words in page
    log = read_run(bag)
    assert (
        f'<th scope="row">questions answered</th><td>{int((log.asked & log.perceived).sum())}</td>'
        in page
    )
    k, row = next(
        (k, r) for r in range(len(log.step)) for k in (0, 1) if log.perceived[r, k]
    )
    told = "\n".join(in_words(log, *explained(log, k, [int(log.step[row])])))
    assert told in unescape(page)
    assert "refused" in page


def test_warnings_are_counted(bag):
    shown = open_run(bag)
    said = [
        SimpleNamespace(name="robot_1", msg="late", level=level)
        for level in (20, 30, 40)
    ]
    shown.log.messages.rosout[:] = said
    tables = [part["rows"] for part in faults(shown) if part["kind"] == "table"]
    assert tables[1] == [("robot_1: late", 2)]


def test_a_baseline_is_not_compared_with_itself(tmp_path, quick):
    scenario = load_scenario("env1").with_settings({"steps": 300})
    train(scenario, "noncoop", 1, engine="python").save(tmp_path / "run")
    page = run_report(open_run(tmp_path / "run"))
    assert "Indiv., same seed" in page and "Non-coop., same seed" not in page


def test_its_command_computes_the_same_bits(trained, tmp_path, monkeypatch, quick):
    page = run_report(open_run(trained), baselines=False)
    assert "Indiv." not in page and "Some questions" not in page
    command = unescape(re.search("<pre>(sparse_coord train.*?)</pre>", page)[1])
    monkeypatch.chdir(tmp_path)
    assert main([*shlex.split(command)[1:], "--out", "again"]) == 0
    again = open_run(tmp_path / "again")
    assert tables_equal(again.tables, open_run(trained).tables)
    assert again.config.digest == load_run(trained).digest


@pytest.mark.long
def test_whatever_comes_from_files_is_escaped(trained, tmp_path):
    evil = '<script>alert("x")</script>&amp;$\\frac{$'
    run = tmp_path / "a<b>&$x$"
    shutil.copytree(trained, run)
    data = yaml.safe_load((run / "run.yaml").read_text())
    data["versions"]["python"] = evil
    grid = data["scenario"]["map"]
    grid["text"] = grid["text"].replace("title:", f"title: {evil!r} #", 1)
    (run / "run.yaml").write_text(yaml.safe_dump(data, sort_keys=False))
    page = run_report(open_run(run), baselines=False)
    assert "script" not in tags_of(page) and "&lt;script&gt;" in page
    assert page.count("&lt;script&gt;") >= 3  # title of the map, version, run.yaml


def test_report_writes_the_file_and_says_what_is_wrong(bag, tmp_path, capsys, quick):
    out = tmp_path / "r.html"
    odd = tmp_path / "odd.mcap"
    data = (bag / "bag_0.mcap").read_bytes()
    place = open_run(bag).recording.blocks[-1].offset + 200
    odd.write_bytes(data[:place] + bytes(64) + data[place + 64 :])
    assert main(["report", str(odd), "--no-baselines", "--out", str(out)]) == 0
    assert "The bag is damaged" in out.read_text()
    tags_of(out.read_text())
    (tmp_path / "run.yaml").write_text("{}")
    for source, words in ((tmp_path / "none", "none"), (tmp_path, "run.yaml")):
        assert main(["report", str(source), "--out", str(out)]) == 2
        error = capsys.readouterr().err.splitlines()[-1]
        assert error.startswith("error: ") and words in error


def test_the_page_of_results_is_whole_and_self_contained(results, tmp_path, capsys):
    out = tmp_path / "r.html"
    assert main(["report", str(results), "--out", str(out)]) == 0
    tags = tags_of(out.read_text())
    assert tags.count("img") == 2 and "script" not in tags
    name = wrapped("env1/coop/penalty=-20,steps=300")
    assert f'<th scope="row">{name}</th>' in out.read_text()
    assert "<p>Failed team: " in out.read_text()
    out.unlink()
    assert main(["report", str(results), "--no-baselines", "--out", str(out)]) == 2
    assert "--no-baselines is for runs" in capsys.readouterr().err
    assert not out.exists()


def test_results_whose_learner_may_not_be_imported_are_left_out(
    results, tmp_path, capsys
):
    """The page says so, too."""
    folder = shutil.copytree(results, tmp_path / "r")
    (folder / "conditions/env1/coop").rename(folder / "conditions/env1/theirs:Team")
    assert main(["report", str(folder), "--out", str(tmp_path / "r.html")]) == 0
    words = "left out results of theirs:Team: "
    assert (
        words in capsys.readouterr().err and words in (tmp_path / "r.html").read_text()
    )


def test_results_of_swap_and_block_are_reported(tmp_path, capsys):
    """A pair that is stopped, and a larger team, whose shortest paths are of trials."""
    conditions = (
        "lane/coop/penalty=-20,steps=300",
        "env2-4r/coop/penalty=-20,interactions=together:anywhere+swap+block,steps=300",
    )
    few = ("--runs", "2", "--trials", "2", "--engine", "python", "--jobs", "1")
    folder = str(tmp_path / "results")
    for _ in range(2):  # the second time they are read
        assert main(["reproduce", *conditions, "--out", folder, *few]) == 0
    out = tmp_path / "r.html"
    assert main(["report", folder, "--out", str(out)]) == 0
    page = out.read_text()
    for one in conditions:
        assert f'<th scope="row">{wrapped(one)}</th>' in page
    last = wrapped(conditions[1])
    row = page.partition(f">{last}</th>")[2].partition("</tr>")[0]
    assert re.search(r"<td>[\d.]+ \(\d\.\d\d\)</td>", row)  # shortest paths
    assert "of trials, with its standard error" in page
