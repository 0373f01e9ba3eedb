import numpy as np
import pytest
from sweeps_for_tests import history, refinement, skipped, write_run

from ge_torchrl.report.canvas import BLUE, VERMILION, save_figure
from ge_torchrl.report.figures import best_curves, convergence_figure, pairs_figure, solving_figure
from ge_torchrl.report.runs import Pair, read_run


@pytest.fixture
def pairs(tmp_path):
    def run(name, seed, best, refined=(), records=()):
        refiner = "ppo" if records else "none"
        return read_run(
            write_run(
                tmp_path / name,
                seed=seed,
                refiner=refiner,
                generations=history(best, refined),
                refinements=records,
            )
        )

    rising, flat = [9.0, 50.0, 300.0, 480.0], [9.0, 9.0, 9.0, 9.0]
    return [
        Pair(run("a", 0, rising, [None, 499.0], [refinement(1), skipped(3)]), run("b", 0, rising)),
        Pair(run("c", 1, flat, [None, None, 20.0], [refinement(2)]), run("d", 1, flat)),
    ]


def lines(figure):
    return [line for line in figure.axes[0].lines if len(line.get_xdata())]


def legend(figure):
    return [text.get_text() for text in figure.axes[0].get_legend().get_texts()]


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


def test_pairs_are_solid_and_dotted_in_one_colour_with_rings_at_applications(pairs):
    figure = pairs_figure(pairs, title="", solved_at=475.0)
    drawn = [(line.get_color(), line.get_linestyle(), list(line.get_ydata())) for line in lines(figure)[1:]]
    assert drawn == [
        (BLUE, ":", [9.0, 50.0, 300.0, 480.0]),
        (BLUE, "-", [9.0, 499.0, 499.0, 499.0]),
        (BLUE, "None", [499.0]),
        (VERMILION, ":", [9.0, 9.0, 9.0, 9.0]),
        (VERMILION, "-", [9.0, 9.0, 20.0, 20.0]),
        (VERMILION, "None", [20.0]),
    ]
    (beside,) = figure.legends
    assert [text.get_text() for text in beside.get_texts()] == [
        "solved from 475",
        "seed 0",
        "seed 1",
        "GE+PPO",
        "GE alone",
        "PPO",
    ]


def test_of_many_refinements_only_the_new_bests_get_a_ring(tmp_path):
    rising = [9.0] * 20 + [500.0] * 20
    records = [refinement(number, new_best=number == 20) for number in range(1, 40)]
    runs = [
        read_run(
            write_run(tmp_path / refiner, refiner=refiner, generations=history(rising), refinements=records)
        )
        for refiner in ("cmaes", "none")
    ]
    figure = pairs_figure([Pair(*runs)], title="", solved_at=None)
    assert list(lines(figure)[-1].get_xdata()) == [20]
    (beside,) = figure.legends
    assert [text.get_text() for text in beside.get_texts()][-3:] == ["GE+CMA-ES", "GE alone", "CMA-ES"]


def test_solving_times_with_an_arrow_for_what_was_never_reached(pairs):
    figure = solving_figure(pairs, title="", solved_at=475.0)
    marks = [
        (line.get_marker(), list(line.get_xdata())) for line in lines(figure) if line.get_marker() != "None"
    ]
    assert marks == [("o", [4]), ("o", [2]), (">", [4]), (">", [4])]
    assert [tick.get_text() for tick in figure.axes[0].get_yticklabels()] == ["seed 0", "seed 1"]


def test_figures_of_equal_runs_are_equal_byte_by_byte(pairs, tmp_path):
    def figures():
        histories = {"GE": [pair.plain.history for pair in pairs]}
        yield convergence_figure(histories, np.random.default_rng(0), title="a", solved_at=475.0)
        yield pairs_figure(pairs, title="a", solved_at=475.0)
        yield solving_figure(pairs, title="a", solved_at=475.0)

    for first, again in zip(figures(), figures(), strict=True):
        written = [save_figure(figure, tmp_path / name) for figure, name in ((first, "x"), (again, "y"))]
        for one, other in zip(*written, strict=True):
            assert one.read_bytes() == other.read_bytes()
