"""The page of a run: its figures are those of the summary, and no text of a file ever becomes markup."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest
from page_runs_for_tests import write_played_run
from sweeps_for_tests import CARTPOLE, write_run

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.errors import ArtefactError
from ge_torchrl.report.html.figures import mean_interval, number, seconds, short_count
from ge_torchrl.report.html.run_page import run_page
from ge_torchrl.report.html.scenes import DRAWN
from ge_torchrl.report.html.template import asset
from ge_torchrl.report.html.writing import write_run_page

EVIL = "<script>alert('a&b')</script>"


class Reader(HTMLParser):
    """Collects the figures, the scripts and all that would be loaded from elsewhere."""

    def __init__(self, text):
        super().__init__()
        self.figures, self.scripts, self.loaded, self._figure, self._script = {}, [], [], None, False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self._figure = given.get("data-figure")
        self._script = tag == "script"
        if self._script:
            self.scripts.append("")
        self.loaded += [
            value for key, value in attrs if key in ("src", "href", "action") and value != "data:,"
        ]

    def handle_endtag(self, _tag):
        self._figure, self._script = None, False

    def handle_data(self, data):
        if self._script:
            self.scripts[-1] += data
        if self._figure:
            self.figures[self._figure] = data


@pytest.fixture
def folder(tmp_path):
    return write_played_run(tmp_path / "run", test_mean=487.4, test_std=12.345, test_episodes=100)


def data_of(text):
    return json.loads(Reader(text).scripts[0])


def test_the_figures_are_those_of_the_summary(folder):
    page, summary = run_page(folder), folder.read_summary()
    figures = Reader(page).figures
    assert figures["test_mean"] == f"{summary.test_mean:.2f}"
    assert figures["test_std"] == f"± {summary.test_std:.2f}"
    assert figures["decision_nodes"] == str(summary.decision_nodes)
    assert figures["depth"] == str(summary.depth)
    assert figures["complexity_M"] == f"{summary.complexity_M:g}"
    assert figures["seed"] == str(summary.seed)
    assert figures["generations"] == str(summary.generations)
    champion = data_of(page)["trees"][0]
    assert (champion["key"], champion["measured"]["mean"]) == ("champion", summary.test_mean)
    assert "Solved" in page
    assert "solved from 475" in page
    assert f"{summary.env_steps_total:,}" in page


def test_the_archive_is_that_of_the_folder(folder):
    trees = {tree["key"]: tree for tree in data_of(run_page(folder))["trees"]}
    for record in folder.read_archive():
        if record.decision_nodes == folder.read_summary().decision_nodes:
            continue
        assert trees[str(record.decision_nodes)]["measured"]["mean"] == record.test_mean
        assert trees[str(record.decision_nodes)]["nodes"] == record.decision_nodes
    assert trees["full"]["measured"]["mean"] == folder.read_summary().test_mean_full


@pytest.mark.parametrize(
    ("solved", "word"), [(True, "Solved"), (False, "Not solved"), (None, "No threshold")]
)
def test_the_verdict_in_one_line(tmp_path, solved, word):
    threshold = None if solved is None else 475.0
    folder = write_played_run(tmp_path / "run", solved=solved, solved_at=threshold, test_mean=-1.5)
    verdict = re.search(r'<p class="verdict">(.*?)</p>', run_page(folder))[1]
    assert f">{word}</span>" in verdict
    assert ">\u22121.50</strong>" in verdict
    assert ("solved from" in verdict) == (solved is not None)


def test_no_text_of_a_file_becomes_markup_or_script(tmp_path):
    names = replace(
        CARTPOLE, features=(EVIL, "b", "c", "</script>"), actions=(EVIL, "${x}"), units=(EVIL, "", "", "")
    )
    folder = write_played_run(tmp_path / EVIL.replace("/", "_"), names=names, warnings=(EVIL, "$title {{x}}"))
    page = run_page(folder)
    reader = Reader(page)
    assert len(reader.scripts) == 2
    assert EVIL not in page
    assert data_of(page)["environment"]["features"][0]["name"] == EVIL
    assert "Warning: $title {{x}}" in page


def test_nothing_is_loaded_from_elsewhere(folder):
    page = run_page(folder)
    assert Reader(page).loaded == []
    assert re.search(r"default-src &#x27;none&#x27;", page)
    # Names of vocabularies are the only addresses.
    assert set(re.findall(r"https?://[\w./]+", page)) == {
        "http://www.w3.org/2000/svg",
        "http://www.w3.org/1998/Math/MathML",
    }


def test_a_run_of_an_earlier_version_has_a_page_without_episodes(tmp_path):
    path = write_run(tmp_path / "run")
    content = data_of(run_page(RunFolder(path)))
    assert (content["episodes"], content["returns"]) == ([], [])
    assert content["trees"][0]["splits"][0]["visits"] is None


def test_a_folder_that_is_no_run_has_none(tmp_path):
    with pytest.raises(ArtefactError):
        write_run_page(tmp_path)
    assert not (tmp_path / "report.html").exists()


def test_marks_stand_only_beside_the_task_that_they_are_of(tmp_path):
    known = data_of(run_page(write_played_run(tmp_path / "one")))["known"]
    assert {mark["kind"] for mark in known} == {"possible", "published"}
    assert {"kind": "published", "nodes": 3, "mean": 500.0, "run": "R1"} in known
    heavy = write_played_run(tmp_path / "two", names=replace(CARTPOLE, kwargs={"gravity": 20}))
    assert data_of(run_page(heavy))["known"] == []


def test_figures_for_a_person():
    assert [number(-1234.5), number(None), number(0.125, 1)] == ["\u22121,234.50", "", "0.1"]
    assert [seconds(1.25), seconds(200), seconds(7500)] == ["1.2 s", "3 min 20 s", "2 h 5 min"]
    assert [short_count(12), short_count(276_578_371), short_count(11_050_444_309)] == [
        "12",
        "277 million",
        "11.1 billion",
    ]
    low, high = mean_interval(10.0, 3.0, 10)
    assert (low, high) == (pytest.approx(10 - 1.96, abs=0.001), pytest.approx(10 + 1.96, abs=0.001))
    assert mean_interval(10.0, 0.0, 1) is None


def test_the_environments_that_are_drawn_are_those_of_the_script():
    scenes = asset("scenes.js").partition("const SCENES = {")[2].partition("};")[0]
    assert set(re.findall(r'^  "([^"]+)":', scenes, re.MULTILINE)) == DRAWN


def test_what_was_done_is_told_as_the_method(tmp_path):
    path = write_run(tmp_path / "run", "GE+PPO+polish", refined=0)
    assert Reader(run_page(RunFolder(path))).figures["method"] == "GE+polish; PPO refined no tree"


def test_the_length_of_a_step_is_that_of_the_episodes_or_known(tmp_path):
    folder = write_played_run(tmp_path / "run")
    assert data_of(run_page(folder))["stepSeconds"] == 0.02
    folder.write_episodes(replace(folder.read_episodes(), step_seconds=0.5))
    assert data_of(run_page(folder))["stepSeconds"] == 0.5
    other = write_played_run(tmp_path / "other", names=replace(CARTPOLE, id="Other-v0"))
    assert data_of(run_page(other))["stepSeconds"] is None


def test_a_few_test_episodes_have_no_interval(tmp_path):
    page = run_page(write_played_run(tmp_path / "run", test_episodes=3))
    assert "95 % interval" not in page.partition("<main")[0]
