import pytest
from records_for_tests import kept
from sweeps_for_tests import write_run

from ge_torchrl.report.runs import read_run
from ge_torchrl.report.sizes import by_size, sizes_figure, sizes_table, trees_of_archive

ARCHIVES = {
    3: [kept(1, 100.0), kept(2, 480.0, validation_mean=499.0)],
    4: [kept(1, 120.0), kept(2, 490.0, validation_mean=495.0), kept(5, 500.0)],
    5: [],
}


def trees(archives=ARCHIVES, champion=2):
    return [tree for seed, archive in archives.items() for tree in trees_of_archive(archive, seed, champion)]


def test_rows_gather_the_runs_that_have_a_size():
    rows = by_size(trees())
    assert [(row.decision_nodes, [tree.seed for tree in row.trees], row.champions) for row in rows] == [
        (1, [3, 4], 0),
        (2, [3, 4], 2),
        (5, [4], 0),
    ]


def test_the_tree_to_take_is_chosen_by_validation_not_by_the_test():
    assert [row.in_validation.mean for row in by_size(trees())] == [120.0, 480.0, 500.0]
    assert [row.best_of_runs.mean for row in by_size(trees())] == [120.0, 490.0, 500.0]


def test_table_of_many_runs():
    assert sizes_table(by_size(trees())).markdown() == (
        "| decision nodes | runs | median | best in validation | its seed | best of runs (chosen by this test) "
        "| its seed | champions |\n"
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n"
        "| 1 | 2 | 110.00 | 120.00 | 4 | 120.00 | 4 | 0 |\n"
        "| 2 | 2 | 485.00 | 480.00 | 3 | 490.00 | 4 | 2 |\n"
        "| 5 | 1 | 500.00 | 500.00 | 4 | 500.00 | 4 | 0 |"
    )


def test_table_of_one_run():
    one = by_size(trees({4: ARCHIVES[4]}))
    assert sizes_table(one).aligned() == (
        "decision nodes  test mean ± sd\n"
        "             1   120.00 ± 1.50\n"
        "             2   490.00 ± 1.50  champion\n"
        "             5   500.00 ± 1.50"
    )
    assert "champion" not in sizes_table(by_size(trees({4: ARCHIVES[4]}, champion=9))).aligned()


def test_trees_that_were_never_tested_are_left_out():
    untested = [kept(1, 9.0), kept(2, None, validation_mean=8.0, test_std=None)]
    assert [tree.decision_nodes for tree in trees_of_archive(untested, 0, 1)] == [1]


def test_json_has_the_same_numbers():
    assert by_size(trees())[1].as_dict() == {
        "decision_nodes": 2,
        "runs": 2,
        "median": 485.0,
        "in_validation": 480.0,
        "in_validation_seed": 3,
        "best_of_runs": 490.0,
        "best_of_runs_seed": 4,
        "champions": 2,
    }


def test_figure_has_a_dot_for_each_tree_and_a_line_of_medians():
    figure = sizes_figure({"GE": by_size(trees())}, title="Any-v0", solved_at=475.0)
    threshold, *dots, line = figure.axes[0].lines
    assert set(threshold.get_ydata()) == {475.0}
    assert [(list(dot.get_xdata()), list(dot.get_ydata())) for dot in dots] == [
        ([1, 1], [100.0, 120.0]),
        ([2, 2], [480.0, 490.0]),
        ([5], [500.0]),
    ]
    assert (list(line.get_xdata()), list(line.get_ydata())) == ([1, 2, 5], [110.0, 485.0, 500.0])


@pytest.mark.parametrize(
    ("archive", "shown"), [([kept(0, -500.0), kept(1, -84.0)], {1}), ([kept(0, -500.0)], {0})]
)
def test_a_lone_leaf_does_not_flatten_the_trees_in_the_figure(archive, shown):
    """It acts always alike, and returns so little that all trees would look the same."""
    rows = by_size(trees({0: archive}))
    figure = sizes_figure({"GE": rows}, title="", solved_at=None)
    assert {x for line in figure.axes[0].lines for x in line.get_xdata()} == shown
    assert rows[0].decision_nodes == 0, "the table has it"


def test_a_run_knows_its_trees(tmp_path):
    run = read_run(write_run(tmp_path / "run", seed=4, decision_nodes=2, archive=ARCHIVES[4]))
    assert list(run.by_size) == trees({4: ARCHIVES[4]})
