"""Settings and files that somebody else made: all are read, or told of in one line."""

import re

import hostile_configurations
import hostile_environments
import hostile_folders
import hostile_trees
import pytest
from hostile_verdicts import judged
from pages_for_tests import ROOT
from runs_for_tests import config

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.errors import ArtefactError

TABLES = {
    "configurations": hostile_configurations,
    "environments": hostile_environments,
    "files in the folder of a run": hostile_folders,
    "files of trees, and paths": hostile_trees,
}
ROW = re.compile(r"^\| (.+?) \| ([\d,]+) \| .+ \| 0 \|$", re.MULTILINE)


def told_counts():
    """What the page says: how many inputs there are of each kind."""
    page = (ROOT / "docs" / "hostile_input.md").read_text()
    return {kind.partition(":")[0]: int(count.replace(",", "")) for kind, count in ROW.findall(page)}


@pytest.mark.parametrize("kind", TABLES)
def test_each_bad_file_is_told_in_one_line(kind, tmp_path, tried):
    wrong, n_tried = {}, 0
    for case in TABLES[kind].cases(tmp_path):
        verdict, n_tried = judged(case.act), n_tried + 1
        if verdict.kind != case.expected:
            wrong[case.name] = verdict
    tried(f"bad input: {kind}", n_tried, len(wrong))
    assert not wrong
    # Each new setting brings some more.
    assert told_counts()[kind] <= n_tried, "docs/hostile_input.md tells of more than there are"


def test_the_readme_tells_how_many_there_are():
    assert f"of which {sum(told_counts().values()):,} pieces are tried" in (ROOT / "README.md").read_text()


@pytest.mark.parametrize(
    "name", ["best_tree.json", "archive", "refinements.jsonl", "config.yaml", "report.html"]
)
def test_a_file_of_somebody_elses_is_not_written_over(name, tmp_path):
    (tmp_path / name).write_text("mine")
    with pytest.raises(ArtefactError, match=rf"must be a folder without a run, .* holds {name} already"):
        RunFolder.create(tmp_path, config())
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "mine"


def test_the_configuration_of_a_run_that_found_nothing_is_replaced(tmp_path):
    RunFolder.create(tmp_path, config(seed=1)).release()
    assert RunFolder.create(tmp_path, config(seed=2)).read_config().seed == 2
