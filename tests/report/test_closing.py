from pathlib import Path

from records_for_tests import summary
from sweeps_for_tests import config, honoured

from ge_torchrl.artefacts import RunFolder
from ge_torchrl.report.closing import EvaluationSummary, closing_text, verdict
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.labels import TreeLabels

leaf, split = DecisionTree.leaf, DecisionTree.split
LABELS = TreeLabels(
    "CartPole-v1", ("x", "x_dot", "theta", "theta_dot"), ("m", "m/s", "rad", "rad/s"), ("left", "right")
)
TREE = split(2, 0.0154, split(3, 0.229, leaf(0), leaf(1)), leaf(1))


def test_closing_summary_in_full():
    text = closing_text(
        summary(decision_nodes=2, complexity_M=35.6, env_steps=6_026_646), TREE, LABELS, Path("out/run")
    )
    assert text == (
        "theta < 0.0154 rad?\n"
        "├─ yes: theta_dot < 0.229 rad/s?\n"
        "│       ├─ yes: left\n"
        "│       └─ no:  right\n"
        "└─ no:  right\n"
        "\n"
        "training    500.00  the champion's fitness on its training episodes\n"
        "validation  490.00  on the episodes that chose it\n"
        "test        487.40 ± 12.35  on 100 unseen episodes\n"
        "verdict     SOLVED: the threshold is a mean return of 475\n"
        "size        2 decision nodes, depth 2, M = 35.6\n"
        "effort      200 generations, 6,026,646 steps of the environment in 0.2 s of evolution, 0.5 s in all\n"
        "run folder  out/run"
    )


def test_the_hall_of_fame_stands_between_with_a_mark_at_the_champion():
    hall = [honoured(1, 199.2, test_std=30.0), honoured(2, 499.98), honoured(11, 500.0, test_std=0.0)]
    text = closing_text(summary(decision_nodes=2), leaf(0), LABELS, Path("run"), hall)
    assert text.splitlines()[:8] == [
        "always left",
        "",
        "decision nodes         test mean ± sd",
        "             1         199.20 ± 30.00",
        "             2          499.98 ± 1.50  <- the champion",
        "            11          500.00 ± 0.00",
        "",
        "training    500.00  the champion's fitness on its training episodes",
    ]


def rows_of(folder, **changes):
    """Return the rows between effort and the folder."""
    lines = closing_text(summary(**changes), leaf(0), LABELS, folder).splitlines()
    return lines[[line.split()[0] if line else "" for line in lines].index("effort") + 1 : -1]


def test_refinements_are_named_after_their_method(tmp_path):
    RunFolder.create(tmp_path / "ppo", config(refiner="ppo"))
    RunFolder.create(tmp_path / "cmaes", config(refiner="cmaes"))
    refined = {"refinements": 4, "refinements_improved": 3, "refine_seconds": 41.23}
    assert rows_of(tmp_path / "ppo", **refined, champion_from="refinement") == [
        "PPO         3 of 4 refinements improved their tree, the champion is a refined tree, 41.2 s"
    ]
    assert rows_of(tmp_path / "cmaes", **refined) == [
        "CMA-ES      3 of 4 refinements improved their tree, the champion is from the population, 41.2 s"
    ]
    assert rows_of(tmp_path / "gone", **refined)[0].startswith("refinement  3 of 4 refinements")
    assert rows_of(tmp_path / "gone") == []


def test_exploring_is_told_with_its_champion(tmp_path):
    RunFolder.create(tmp_path / "run", config(refiner="cmaes"))
    explored = {"explored": 1593, "explore_seconds": 47.96}
    assert rows_of(tmp_path / "run", **explored) == [
        "exploring   1,593 trees refined from the hall of fame, 48.0 s"
    ]
    refined = {"refinements": 4, "refinements_improved": 3, "refine_seconds": 1.0}
    assert rows_of(tmp_path / "run", **explored, **refined, champion_from="neighbour") == [
        "CMA-ES      3 of 4 refinements improved their tree, 1.0 s",
        "exploring   1,593 trees refined from the hall of fame, the champion is one of them, 48.0 s",
    ]


def test_an_early_end_is_told_first():
    text = closing_text(summary(stopped_by="interrupt"), leaf(0), LABELS, Path("run"))
    assert text.splitlines()[:3] == ["always left", "", "stopped by  interrupt"]


def test_verdicts():
    assert verdict(True, -110.0) == "SOLVED: the threshold is a mean return of -110"
    assert verdict(False, 475.0).startswith("not solved")
    assert verdict(None, None) == "no threshold is agreed on for this environment"


def test_evaluation_in_words():
    measured = EvaluationSummary(
        "CartPole-v1", 499.968, 1.0, 490.0, 500.0, 1000, 10000, True, 475.0, "compiled", 2
    )
    assert measured.as_text() == (
        "CartPole-v1: mean return 499.968 ± 1.000 (min 490, max 500) over 1000 episodes\n"
        "seeds 10000 to 10999, compiled route, 2 decision nodes\n"
        "SOLVED: the threshold is a mean return of 475"
    )
