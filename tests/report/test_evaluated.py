import json

import pytest

from ge_torchrl.report.evaluated import (
    EvaluatedMethod,
    EvaluatedRun,
    EvaluatedTree,
    SweepEvaluation,
    ValidatedTree,
)

RUNS = (
    EvaluatedRun(
        "a",
        2,
        41.23,
        EvaluatedTree(2, 490.0, 1.5),
        (ValidatedTree(1, 210.0, 9.0, 200.0), ValidatedTree(2, 490.0, 1.5, 499.0)),
    ),
    EvaluatedRun(
        "b",
        7,
        100.0,
        EvaluatedTree(3, 470.0, 20.0),
        (
            ValidatedTree(1, 190.0, 9.0, 205.0),
            ValidatedTree(2, 495.0, 1.5, 480.0),
            ValidatedTree(3, 470.0, 20.0, 500.0),
        ),
    ),
    EvaluatedRun("c", 8, 5.0, EvaluatedTree(12, 475.0, 0.0), ()),
)


def method(runs=RUNS, solved_at=475.0):
    return EvaluatedMethod("CartPole-v1", "GE+CMA-ES", 500, solved_at, "compiled", runs)


def sweep(*methods):
    return SweepEvaluation(10_000, 1_000_000, methods or (method(),), ("x: broken",))


def test_text_in_full():
    assert sweep().as_text() == (
        "CartPole-v1 GE+CMA-ES (10,000 episodes, seeds 1000000 to 1009999, compiled route, solved from 475)\n"
        "\n"
        "seed  decision nodes  test mean ± sd  solved  run s\n"
        "   2               2   490.00 ± 1.50     yes   41.2\n"
        "   7               3  470.00 ± 20.00      no  100.0\n"
        "   8              12   475.00 ± 0.00     yes    5.0\n"
        "\n"
        "solved 2 of 3, worst seed mean 470.00, median seed mean 475.00\n"
        "\n"
        'By size. "Best in validation" did best of all runs on as many other episodes, the same for all.\n'
        '"Best of runs" is chosen by this test itself, so its mean flatters.\n'
        "\n"
        "decision nodes  runs  median  best in validation  its seed  best of runs (chosen by this test)  its seed\n"
        "             1     2  200.00              190.00         7                              210.00         2\n"
        "             2     2  492.50              490.00         2                              495.00         7\n"
        "             3     1  470.00              470.00         7                              470.00         7"
    )


def test_markdown_can_be_pasted():
    lines = sweep().as_markdown().splitlines()
    assert lines[0].startswith("**CartPole-v1 GE+CMA-ES** (10,000 episodes, ")
    assert lines[2:5] == [
        "| seed | decision nodes | test mean ± sd | solved | run s |",
        "| --- | ---: | ---: | ---: | ---: |",
        "| 2 | 2 | 490.00 ± 1.50 | yes | 41.2 |",
    ]
    assert "* solved 2 of 3, worst seed mean 470.00, median seed mean 475.00." in lines
    assert "| 1 | 2 | 200.00 | 190.00 | 7 | 210.00 | 2 |" in lines


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
        "decision_nodes": 1,
        "validation_mean": 205.0,
        "mean": 190.0,
        "std": 9.0,
    }
    assert one["sizes"][0] == {
        "decision_nodes": 1,
        "runs": 2,
        "median": 200.0,
        "in_validation": 190.0,
        "in_validation_seed": 7,
        "best_of_runs": 210.0,
        "best_of_runs_seed": 2,
    }


@pytest.mark.parametrize("form", [SweepEvaluation.as_text, SweepEvaluation.as_markdown])
def test_without_threshold_and_hall_of_fame_less_is_told(form):
    text = form(sweep(method(RUNS[2:], solved_at=None)))
    assert "olved" not in text.replace("| solved |", "").replace("solved  run s", "")
    assert "By size" not in text
    assert "worst seed mean 475.00, median seed mean 475.00" in text


def test_environments_stand_one_below_the_other():
    assert sweep(method(), method()).as_text() == "\n\n".join([sweep().as_text()] * 2)


def test_seeds_that_stand_twice_are_noticed():
    assert method((RUNS[0], RUNS[0])).in_short().endswith("490.00; some seeds stand more than once")
