"""Files that somebody else made: whatever they hold, a sound reading or one line that says what is wrong."""

import hostile_folders
import hostile_trees
import pytest
from hostile_verdicts import judged


@pytest.mark.parametrize("table", [hostile_folders, hostile_trees])
def test_each_bad_file_is_told_in_one_line(table, tmp_path):
    wrong = {}
    for case in table.cases(tmp_path):
        verdict = judged(case.act)
        if verdict.kind != case.expected:
            wrong[case.name] = verdict
    assert not wrong
