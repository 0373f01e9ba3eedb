import re

import pytest
from sweeps_for_tests import honoured, write_run

from ge_torchrl.artefacts import RunFolder
from ge_torchrl.errors import ArtefactError
from ge_torchrl.report.hall_of_fame import by_size, hall_of_fame_table, size_figure
from ge_torchrl.report.runs import read_run
from ge_torchrl.report.sweep import write_report

HALLS = [
    [honoured(1, 100.0), honoured(2, 480.0, validation_mean=499.0)],
    [honoured(1, 120.0), honoured(2, 490.0, validation_mean=495.0), honoured(5, 500.0)],
    [],
]


@pytest.fixture
def runs(tmp_path):
    return [
        read_run(write_run(tmp_path / "sweep" / str(seed), seed=seed, decision_nodes=2, hall_of_fame=hall))
        for seed, hall in enumerate(HALLS)
    ]


def test_records_go_there_and_back(runs):
    assert [list(run.hall_of_fame) for run in runs] == HALLS


def test_rows_gather_the_runs_that_have_a_size(runs):
    rows = by_size(runs)
    assert [(row.decision_nodes, row.test_means, row.champions) for row in rows] == [
        (1, (100.0, 120.0), 0),
        (2, (480.0, 490.0), 2),
        (5, (500.0,), 0),
    ]


def test_the_tree_to_take_is_chosen_by_validation_not_by_the_test(runs):
    assert [row.chosen for row in by_size(runs)] == [120.0, 480.0, 500.0]


def test_table_in_full(runs):
    assert hall_of_fame_table(runs) == (
        "| decision nodes | runs | mean test return | median | best in validation | champions |\n"
        "| --- | ---: | ---: | ---: | ---: | ---: |\n"
        "| 1 | 2 | 110.00 | 110.00 | 120.00 | 0 |\n"
        "| 2 | 2 | 485.00 | 485.00 | 480.00 | 2 |\n"
        "| 5 | 1 | 500.00 | 500.00 | 500.00 | 0 |"
    )


def test_figure_has_a_dot_for_each_tree_and_a_line_of_medians(runs):
    figure = size_figure({"GE": runs}, title="Any-v0", solved_at=475.0)
    threshold, *dots, line = figure.axes[0].lines
    assert set(threshold.get_ydata()) == {475.0}
    assert [(list(dot.get_xdata()), list(dot.get_ydata())) for dot in dots] == [
        ([1, 1], [100.0, 120.0]),
        ([2, 2], [480.0, 490.0]),
        ([5], [500.0]),
    ]
    assert (list(line.get_xdata()), list(line.get_ydata())) == ([1, 2, 5], [110.0, 485.0, 500.0])


def test_a_lone_leaf_does_not_flatten_the_trees_in_the_figure(tmp_path):
    """It acts always alike, and returns so little that all trees would look the same."""
    halls = ([honoured(0, -500.0), honoured(1, -84.0)], [honoured(0, -500.0)])
    runs = [
        read_run(write_run(tmp_path / str(seed), seed=seed, decision_nodes=1, hall_of_fame=hall))
        for seed, hall in enumerate(halls)
    ]
    sizes = [
        {
            x
            for line in size_figure({"GE": some}, title="", solved_at=None).axes[0].lines
            for x in line.get_xdata()
        }
        for some in (runs, runs[1:])
    ]
    assert sizes == [{1}, {0}], "where there is nothing else it is shown"
    assert [row.decision_nodes for row in by_size(runs)] == [0, 1], "the table has it"


def test_report_shows_table_and_figure_where_a_run_has_a_hall_of_fame(runs, tmp_path):
    text = write_report(tmp_path / "sweep", None, tmp_path / "out").read_text()
    assert hall_of_fame_table(runs) in text
    (figure,) = re.findall(r"\((figures/[^)]*-sizes\.svg)\)", text)
    assert (tmp_path / "out" / figure).exists()


def test_a_broken_line_is_named(runs):
    (runs[0].path / "hall_of_fame.jsonl").write_text("{}\n")
    with pytest.raises(ArtefactError, match=r"hall_of_fame\.jsonl:1 .* HallOfFameRecord; missing"):
        RunFolder(runs[0].path).read_hall_of_fame()
