# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a run and of results: whole, self-contained, escaped, and true."""

import base64
import re
import shlex
import shutil
from html import unescape
from html.parser import HTMLParser
from xml.etree import ElementTree

import pytest
import yaml

from sparse_coord_ros.cli.main import main
from sparse_coord_ros.learn.run_config import load_run
from sparse_coord_ros.learn.simulation import tables_equal
from sparse_coord_ros.look.report import results_report, run_report
from sparse_coord_ros.look.results import ResultsShown
from sparse_coord_ros.look.sources import open_shown
from sparse_coord_ros.runlog.explain import explain, in_words
from sparse_coord_ros.runlog.log import read_run
from sparse_coord_ros.solve.exact import evaluate_exact

VOID = {"meta", "br", "img", "link"}


class Checker(HTMLParser):
    """Reads a page strictly: tags close in order, nothing comes from elsewhere."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags = [], []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attributes:
            assert not name.startswith("on")
            if name in ("href", "src"):
                assert value.startswith("data:image/svg+xml;base64,"), value
                ElementTree.fromstring(base64.b64decode(value.partition(",")[2]))

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture
def quick(monkeypatch):
    """Let pages have one picture."""
    monkeypatch.setattr("sparse_coord_ros.look.figures.available", lambda shown: ["policy"])


@pytest.fixture(scope="module")
def page(bag):
    return run_report(open_shown(bag))


def test_the_page_of_a_bag_is_whole_and_self_contained(page):
    found = Checker(page)
    assert found.tags.count("img") == 5 and "script" not in found.tags
    headings = re.findall("<h2>(.*?)</h2>", page)
    assert headings == [
        "The value of the team",
        "What was learned",
        "Some questions and answers",
        "Faults and diagnostics",
        "Scenario",
        "How to reproduce it",
    ]


def test_its_numbers_are_those_of_the_log(page, bag):
    shown = open_shown(bag)
    exact = evaluate_exact(shown.config.scenario, shown.tables, learner="coop")
    assert f"<td>{exact.reward.mean:.2f} ± {exact.reward.spread:.2f}</td>" in page
    for words in ("exact joint optimum", "121.89", "fixed shortest paths", "Indiv., same seed"):
        assert words in page
    log = read_run(bag)
    assert f"<td>percepts answered</td><td>{int((log.asked & log.perceived).sum())}</td>" in page
    k, row = next((k, r) for r in range(len(log.step)) for k in (0, 1) if log.perceived[r, k])
    told = "\n".join(in_words(log, explain(log, k, int(log.step[row]))))
    assert told in unescape(page)
    assert "refused" in page


def test_its_command_computes_the_same_bits(trained, tmp_path, monkeypatch, quick):
    page = run_report(open_shown(trained), baselines=False)
    assert "Indiv." not in page and "Some questions" not in page
    command = unescape(re.search("<pre>(sparse_coord train.*?)</pre>", page)[1])
    monkeypatch.chdir(tmp_path)
    assert main([*shlex.split(command)[1:], "--out", "again"]) == 0
    again = open_shown(tmp_path / "again")
    assert tables_equal(again.tables, open_shown(trained).tables)
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
    page = run_report(open_shown(run), baselines=False)
    found = Checker(page)
    assert "script" not in found.tags and "&lt;script&gt;" in page
    assert page.count("&lt;script&gt;") >= 3  # title of the map, version, run.yaml


def test_the_page_of_results(results):
    page = results_report(ResultsShown(results))
    found = Checker(page)
    assert found.tags.count("img") == 2
    ids = [f"env1/{learner}/penalty=-20,steps=300" for learner in ("coop", "noncoop")]
    assert f"reproduce {ids[0]} {ids[1]}" in page


def test_report_writes_the_file_and_says_what_is_wrong(bag, trained, tmp_path, capsys, quick):
    out = tmp_path / "r.html"
    assert main(["report", str(trained), "--no-baselines", "--out", str(out)]) == 0
    assert out.read_text().startswith("<!doctype html>")
    cut = tmp_path / "cut.mcap"
    data = (bag / "bag_0.mcap").read_bytes()
    cut.write_bytes(data[: len(data) // 2])
    assert main(["report", str(cut), "--no-baselines", "--out", str(out)]) == 0
    Checker(out.read_text())
    capsys.readouterr()
    cut.write_bytes(b"")
    for source, words in ((cut, "cut.mcap"), (tmp_path / "none", "none"), (tmp_path, "run.yaml")):
        if source == tmp_path:
            (tmp_path / "run.yaml").write_text("{}")
        assert main(["report", str(source), "--out", str(out)]) == 2
        error = capsys.readouterr().err.splitlines()[-1]
        assert error.startswith("error: ") and words in error
