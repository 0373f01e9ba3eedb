import json

import pytest

from ge_torchrl.report.evaluated import (
    EvaluatedMethod,
    EvaluatedRun,
    EvaluationSummary,
    SweepEvaluation,
    verdict,
)
from ge_torchrl.report.sizes import SizedTree
from ge_torchrl.report.tables import RunRow


def run(path, seed, row, *sizes):
    trees = tuple(SizedTree(seed, *tree, is_champion=tree[0] == row[0]) for tree in sizes)
    return EvaluatedRun(path, RunRow(seed, *row), trees)


RUNS = (
    run("a", 2, (2, 490.0, 1.5, True, 41.23), (1, 210.0, 9.0, 200.0), (2, 490.0, 1.5, 499.0)),
    run(
        "b",
        7,
        (3, 470.0, 20.0, False, 100.0),
        (1, 190.0, 9.0, 205.0),
        (2, 495.0, 1.5, 480.0),
        (3, 470.0, 20.0, 500.0),
    ),
    run("c", 8, (12, 475.0, 0.0, True, 5.0)),
)


def method(runs=RUNS, solved_at=475.0):
    return EvaluatedMethod("CartPole-v1", "GE+CMA-ES", 500, solved_at, "kernel", runs)


def sweep(*methods):
    return SweepEvaluation(10_000, 1_000_000, methods or (method(),), ("x: broken",))


def test_one_tree_in_words():
    measured = EvaluationSummary(
        "CartPole-v1", 499.968, 1.0, 490.0, 500.0, 1000, 10000, True, 475.0, "kernel", 2
    )
    assert measured.as_text() == (
        "CartPole-v1: mean return 499.968 ± 1.000 (min 490, max 500) over 1,000 episodes\n"
        "seeds 10000 to 10999, kernel route, 2 decision nodes\n"
        "SOLVED: the threshold is a mean return of 475"
    )


def test_verdicts():
    assert verdict(True, -110.0) == "SOLVED: the threshold is a mean return of -110"
    assert verdict(False, 475.0).startswith("not solved")
    assert verdict(None, None) == "no threshold is agreed on for this environment"


def test_text_in_full():
    assert sweep().as_text() == (
        "CartPole-v1 GE+CMA-ES (10,000 episodes, seeds 1000000 to 1009999, kernel route, solved from 475)\n"
        "\n"
        "seed  decision nodes  test mean ± sd  solved  all s\n"
        "   2               2   490.00 ± 1.50     yes   41.2\n"
        "   7               3  470.00 ± 20.00      no  100.0\n"
        "   8              12   475.00 ± 0.00     yes    5.0\n"
        " all             5.7          478.33  2 of 3   48.7\n"
        "\n"
        "solved 2 of 3, worst seed mean 470.00, median seed mean 475.00\n"
        "\n"
        'By size. "Best in validation" did best of all runs on as many other episodes, the same for all.\n'
        '"Best of runs" is chosen by this test itself, so its mean flatters.\n'
        "\n"
        "decision nodes  runs  median  best in validation  its seed  best of runs (chosen by this test)  its seed"
        "  champions\n"
        "             1     2  200.00              190.00         7                              210.00         2"
        "          0\n"
        "             2     2  492.50              490.00         2                              495.00         7"
        "          1\n"
        "             3     1  470.00              470.00         7                              470.00         7"
        "          1"
    )


def test_one_run_has_no_rivals():
    text = sweep(method(RUNS[:1])).as_text()
    assert "validation" not in text
    assert text.endswith(
        "decision nodes  test mean ± sd\n"
        "             1   210.00 ± 9.00\n"
        "             2   490.00 ± 1.50  champion"
    )


def test_markdown_can_be_pasted():
    lines = sweep().as_text("markdown").splitlines()
    assert lines[0].startswith("**CartPole-v1 GE+CMA-ES** (10,000 episodes, ")
    assert lines[2:5] == [
        "| seed | decision nodes | test mean ± sd | solved | all s |",
        "| --- | ---: | ---: | ---: | ---: |",
        "| 2 | 2 | 490.00 ± 1.50 | yes | 41.2 |",
    ]
    assert "* solved 2 of 3, worst seed mean 470.00, median seed mean 475.00." in lines
    assert "| 1 | 2 | 200.00 | 190.00 | 7 | 210.00 | 2 | 0 |" in lines


def test_json_holds_the_same():
    told = json.loads(json.dumps(sweep().as_dict()))
    assert (told["episodes"], told["seed"], told["left_out"]) == (10_000, 1_000_000, ["x: broken"])
    (one,) = told["methods"]
    assert (one["solved"], one["worst_mean"], one["median_mean"]) == (2, 470.0, 475.0)
    assert [(run["seed"], run["mean"], run["solved"]) for run in one["runs"]] == [
        (2, 490.0, True),
        (7, 470.0, False),
        (8, 475.0, True),
    ]
    assert one["runs"][1]["by_size"][0] == {
        "seed": 7,
        "decision_nodes": 1,
        "mean": 190.0,
        "std": 9.0,
        "validation_mean": 205.0,
        "is_champion": False,
    }
    assert one["sizes"][0] == {
        "decision_nodes": 1,
        "runs": 2,
        "median": 200.0,
        "in_validation": 190.0,
        "in_validation_seed": 7,
        "best_of_runs": 210.0,
        "best_of_runs_seed": 2,
        "champions": 0,
    }


@pytest.mark.parametrize("form", ["plain", "markdown", "terminal"])
def test_without_threshold_and_archive_less_is_told(form):
    unsolved = run("c", 8, (12, 475.0, 0.0, None, 5.0))
    text = sweep(method((unsolved,), solved_at=None)).as_text(form)
    assert "olved" not in text
    assert "By size" not in text
    assert "worst seed mean 475.00, median seed mean 475.00" in text


def test_environments_stand_one_below_the_other():
    assert sweep(method(), method()).as_text() == "\n\n".join([sweep().as_text()] * 2)


def test_seeds_that_stand_twice_are_noticed():
    assert method((RUNS[0], RUNS[0])).in_short().endswith("490.00; some seeds stand more than once")
