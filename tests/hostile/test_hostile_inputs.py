"""Settings and files that somebody else made: all are read, or told of in one line."""

import hostile_configurations
import hostile_environments
import hostile_folders
import hostile_trees
import pytest
from hostile_verdicts import judged
from runs_for_tests import config

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.errors import ArtefactError


@pytest.mark.parametrize(
    "table", [hostile_configurations, hostile_environments, hostile_folders, hostile_trees]
)
def test_each_bad_file_is_told_in_one_line(table, tmp_path):
    wrong = {}
    for case in table.cases(tmp_path):
        verdict = judged(case.act)
        if verdict.kind != case.expected:
            wrong[case.name] = verdict
    assert not wrong


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
