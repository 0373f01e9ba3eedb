"""Five generations of a small run and its verdict, as they stand in a file."""

import json

from golden_run import PATH, as_text, golden_run


def test_the_golden_run_is_what_it_was():
    """Where a change of results is meant, `python tests/support/golden_run.py` writes the file anew."""
    found, text = golden_run(), PATH.read_text(encoding="utf-8")
    # By parts first, so that what differs is seen.
    expected = json.loads(text)
    for part in (*expected, *found):
        assert found.get(part) == expected.get(part), part
    assert as_text(found) == text


def test_the_golden_run_is_about_something():
    golden = json.loads(PATH.read_text(encoding="utf-8"))
    assert {refinement["origin"] for refinement in golden["refinements"]} == {
        "individual",
        "neighbour",
        "archive",
    }
    assert {"improved", "not_improved"} == {refinement["outcome"] for refinement in golden["refinements"]}
    assert any(refinement["written_back"] for refinement in golden["refinements"])
    assert len({member["origin"] for member in golden["archive"]}) > 1
    assert golden["generations"][-1]["polished"] > golden["generations"][-1]["refined"] > 0
    assert set(golden["steps"]) == {
        "training", "archive", "neighbours", "refinement", "polish", "measuring", "final refinement",
        "validation", "test",
    }  # fmt: skip
