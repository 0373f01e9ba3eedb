from dataclasses import replace

import numpy as np
from records_for_tests import history
from sweeps_for_tests import write_run

from ge_torchrl.report.canvas import save_figure
from ge_torchrl.report.figures import best_curves, convergence_figure, starts_of
from ge_torchrl.report.runs import read_runs


def lines(figure):
    return [line for line in figure.axes[0].lines if len(line.get_xdata())]


def legend(figure):
    (beside,) = figure.legends
    return [text.get_text() for text in beside.get_texts()]


def test_curves_count_refined_trees_and_keep_the_last_value_of_a_short_run():
    curves = best_curves([history([1.0, 2.0, 3.0, 4.0], [None, None, 9.0]), history([None, 5.0])])
    np.testing.assert_array_equal(curves, [[1.0, 2.0, 9.0, 9.0], [np.nan, 5.0, 5.0, 5.0]])


def test_mean_curve_with_its_threshold_and_band():
    histories = {"GE": [history([1.0, 2.0, 3.0]), history([3.0, 6.0, 9.0])]}
    figure = convergence_figure(histories, np.random.default_rng(0), title="Any-v0", solved_at=7.0)
    threshold, mean = lines(figure)
    assert set(threshold.get_ydata()) == {7.0}
    assert threshold.get_linestyle() == "--"
    np.testing.assert_array_equal(mean.get_xdata(), [0, 1, 2])
    np.testing.assert_array_equal(mean.get_ydata(), [2.0, 4.0, 6.0])
    (band,) = figure.axes[0].collections
    edges = band.get_paths()[0].vertices
    # Of two runs, resamples reach both.
    assert (edges[:, 1].min(), edges[:, 1].max()) == (1.0, 9.0)
    assert legend(figure) == ["solved from 7", "GE, mean of 2 runs"]


def test_a_single_run_has_no_band_and_no_threshold_no_line():
    figure = convergence_figure(
        {"GE": [history([1.0, 2.0])]}, np.random.default_rng(0), title="", solved_at=None
    )
    assert not figure.axes[0].collections
    assert len(lines(figure)) == 1


def test_generations_in_which_a_run_has_no_tree_are_left_out():
    histories = {"GE": [history([None, 2.0]), history([3.0, 4.0])]}
    (mean,) = lines(convergence_figure(histories, np.random.default_rng(0), title="", solved_at=None))
    assert (list(mean.get_xdata()), list(mean.get_ydata())) == ([1], [3.0])


def test_runs_that_never_had_a_tree_leave_an_empty_figure(tmp_path):
    histories = {"GE": [history([None, None]), history([None, None])]}
    figure = convergence_figure(histories, np.random.default_rng(0), title="", solved_at=1.0)
    save_figure(figure, tmp_path / "empty")


def test_figures_of_equal_runs_are_equal_byte_by_byte(tmp_path):
    written = []
    for name in ("x", "y"):
        rng = np.random.default_rng(0)
        figure = convergence_figure({"GE": [history([1.0, 5.0])] * 2}, rng, title="a", solved_at=475.0)
        written.append([path.read_bytes() for path in save_figure(figure, tmp_path / name)])
    assert written[0] == written[1]


def test_a_line_breaks_where_runs_begin_anew():
    histories = {"GE": [history([1.0, 2.0, -5.0, 3.0])] * 2}
    figure = convergence_figure(
        histories, np.random.default_rng(0), title="", solved_at=None, starts={"GE": {2}}
    )
    (mean,) = lines(figure)
    np.testing.assert_array_equal(mean.get_xdata(), [0, 1, np.nan, 2, 3])
    np.testing.assert_array_equal(mean.get_ydata(), [1.0, 2.0, np.nan, -5.0, 3.0])


def test_starts_are_those_of_the_configuration(tmp_path):
    write_run(tmp_path / "run", "GE")
    (run,) = read_runs(tmp_path).runs
    assert starts_of([run]) == set()
    anew = replace(run, config=replace(run.config, ge=replace(run.config.ge, generations=12, restarts=1)))
    assert starts_of([run, anew]) == {4}
