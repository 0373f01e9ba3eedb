import pytest
from records_for_tests import history, refinement, skipped
from sweeps_for_tests import write_run

from ge_torchrl.report.canvas import BLUE, VERMILION, save_figure
from ge_torchrl.report.runs import read_run
from ge_torchrl.report.thesis.figures import pairs_figure, solving_figure
from ge_torchrl.report.thesis.pairs import Pair


@pytest.fixture
def pairs(tmp_path):
    def run(name, seed, best, refined=(), records=()):
        method = "GE+PPO" if records else "GE"
        generations = history(best, refined)
        return read_run(
            write_run(tmp_path / name, method, seed=seed, generations=generations, refinements=records)
        )

    rising, flat = [9.0, 50.0, 300.0, 480.0], [9.0, 9.0, 9.0, 9.0]
    return [
        Pair(run("a", 0, rising, [None, 499.0], [refinement(1), skipped(3)]), run("b", 0, rising)),
        Pair(run("c", 1, flat, [None, None, 20.0], [refinement(2)]), run("d", 1, flat)),
    ]


def lines(figure):
    return [line for line in figure.axes[0].lines if len(line.get_xdata())]


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


def test_without_rings_the_legend_explains_none(tmp_path):
    runs = [
        read_run(write_run(tmp_path / method, method, generations=history([9.0, 10.0])))
        for method in ("GE+PPO", "GE")
    ]
    (beside,) = pairs_figure([Pair(*runs)], title="", solved_at=None).legends
    assert [text.get_text() for text in beside.get_texts()] == ["seed 0", "GE+PPO", "GE alone"]


def test_of_many_refinements_only_the_new_bests_get_a_ring(tmp_path):
    rising = [9.0] * 20 + [500.0] * 20
    records = [refinement(number, new_best=number == 20) for number in range(1, 40)]
    runs = [
        read_run(write_run(tmp_path / method, method, generations=history(rising), refinements=records))
        for method in ("GE+CMA-ES", "GE")
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
    (above,) = figure.legends
    handles = {
        text.get_text(): (handle.get_marker(), handle.get_color(), handle.get_markerfacecolor())
        for text, handle in zip(above.get_texts(), above.legend_handles, strict=True)
    }
    assert handles == {
        "GE+PPO": ("o", BLUE, BLUE),
        "GE alone": ("o", VERMILION, "none"),
        "GE+PPO, not within the run": (">", BLUE, BLUE),
        "GE alone, not within the run": (">", VERMILION, "none"),
    }


def test_figures_of_equal_runs_are_equal_byte_by_byte(pairs, tmp_path):
    def figures():
        yield pairs_figure(pairs, title="a", solved_at=475.0)
        yield solving_figure(pairs, title="a", solved_at=475.0)

    for first, again in zip(figures(), figures(), strict=True):
        written = [save_figure(figure, tmp_path / name) for figure, name in ((first, "x"), (again, "y"))]
        for one, other in zip(*written, strict=True):
            assert one.read_bytes() == other.read_bytes()
