import math
from pathlib import Path

import pytest
from records_for_tests import kept, summary
from sweeps_for_tests import PRUNED, controller, leaf

from ge_torchrl.run.closing import closing_text, tree_text
from ge_torchrl.run.refinement_lines import bettered
from ge_torchrl.trees.controller import Controller, Names
from ge_torchrl.trees.tree import DecisionTree

CHAMPION, LEAF = controller(PRUNED), controller(leaf(0))


def test_closing_summary_in_full():
    found = summary(decision_nodes=2, complexity_M=35.6, steps={"fitness": 6_026_646}, test_episodes=1000)
    assert closing_text(found, CHAMPION, Path("out/run")) == (
        "theta < 0.0154 rad?\n"
        "├─ yes: theta_dot < 0.229 rad/s?\n"
        "│       ├─ yes: left\n"
        "│       └─ no:  right\n"
        "└─ no:  right\n"
        "\n"
        "training    500.00  the champion's fitness on its training episodes\n"
        "validation  490.00  on the episodes that chose it\n"
        "test        487.40 ± 12.35  on 1,000 unseen episodes\n"
        "verdict     SOLVED: the threshold is a mean return of 475\n"
        "size        2 decision nodes, depth 2, M = 35.6\n"
        "effort      200 generations, 6,026,646 steps of the environment, 0.2 s of search, 0.5 s in all\n"
        "run folder  out/run"
    )


def test_the_archive_stands_between_with_a_mark_at_the_champion():
    archive = [kept(1, 199.2, test_std=30.0), kept(2, 499.98), kept(11, 500.0, test_std=0.0)]
    text = closing_text(summary(decision_nodes=2), LEAF, Path("run"), archive)
    assert text.splitlines()[:8] == [
        "always left",
        "",
        "decision nodes  test mean ± sd",
        "             1  199.20 ± 30.00",
        "             2   499.98 ± 1.50  champion",
        "            11   500.00 ± 0.00",
        "",
        "training    500.00  the champion's fitness on its training episodes",
    ]


def rows_of(refiner="PPO", improved=None, once_more="", **changes):
    """Return the rows between effort and the folder."""
    found = summary(**changes)
    lines = closing_text(
        found, LEAF, Path("run"), (), refiner, improved=improved, once_more=once_more
    ).splitlines()
    return lines[[line.split()[0] if line else "" for line in lines].index("effort") + 1 : -1]


def test_what_was_refined_and_polished_is_told_with_the_champion():
    refined = {"refined": 279, "refinements": 9, "refinements_improved": 7, "refine_seconds": 41.23}
    assert rows_of(**refined, improved=31, champion_from="refinement") == [
        "PPO         279 trees refined in 41.2 s, 31 of them improved; the champion is a refined tree"
    ]
    assert rows_of("CMA-ES", **refined, polished=1593, polish_seconds=47.96, champion_from="polish") == [
        "CMA-ES      279 trees refined in 41.2 s",
        "polish      1,593 trees polished in 48.0 s; the champion is a polished tree",
    ]
    assert rows_of(polished=1) == [
        "polish      1 tree polished in 0.0 s; the champion is from the population"
    ]
    assert rows_of() == []
    assert rows_of(once_more="kept trees") == ["once more   kept trees"]


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        (
            {1: 9.0, 2: 500.0},
            {1: 9.0, 2: 500.0},
            "kept trees of 2 sizes refined once more, none became better",
        ),
        (
            {0: 9.0, 2: 490.0},
            {0: 9.0, 2: 500.0, 3: 400.0},
            (
                "kept trees of 1 size refined once more, 2 became better; by decision nodes "
                "2: 490.00 -> 500.00, 3: - -> 400.00"
            ),
        ),
    ],
)
def test_what_the_last_refinement_changed_is_one_line(before, after, told):
    assert bettered(before, after) == told


def test_one_of_a_thing_is_no_more():
    text = closing_text(summary(generations=1, decision_nodes=1), LEAF, Path("run"))
    assert "\neffort      1 generation, " in text
    assert "\nsize        1 decision node, " in text


def test_rows_are_broken_between_words_where_the_terminal_is_narrow():
    text = closing_text(summary(warnings=("one two three",)), LEAF, Path("a/long/path-to/the-run"), width=20)
    assert text.endswith(
        "warning     one two\n            three\nrun folder\n            a/long/path-to/the-run"
    )


def test_warnings_have_a_line_each():
    assert rows_of(warnings=("one", "two")) == ["warning     one", "warning     two"]


def test_an_early_end_is_told_first():
    text = closing_text(summary(stopped_by="interrupt"), LEAF, Path("run"))
    assert text.splitlines()[:3] == ["always left", "", "stopped by  interrupt"]


def test_a_tree_is_drawn_and_told_in_rules():
    drawn, rules = tree_text(CHAMPION).split("\n\n")
    assert drawn.startswith("theta < 0.0154 rad?\n├─ yes: ")
    assert rules.startswith("if theta < 0.0154 rad and theta_dot < 0.229 rad/s then left\n")


def rule_of(bounds, constants, slopes):
    names = Names("Thrust-v0", ("x",), ("",), ("main", "side")[: len(bounds)], action_bounds=bounds)
    return tree_text(Controller(DecisionTree.value_leaf(constants, slopes), names)).splitlines()[:-2]


def test_what_may_lie_outside_an_actions_bounds_is_said_to_be_clipped():
    assert rule_of([(-2.0, 2.0)], [0.5], {0: [-8.0]}) == [
        "always main = 0.5 - 8 x",
        "values are clipped to -2 to 2",
    ]
    two = rule_of([(0.0, 1.0), (-math.inf, 0.4)], [0.5, 1.5], {})
    assert two[1:] == ["values are clipped to main 0 to 1, side -inf to 0.4"]
    assert rule_of([(-1.0, 1.0), (-1.0, 1.0)], [3, 1], {})[1:] == ["values are clipped to -1 to 1"]
    assert rule_of([(-1.0, 1.0)], [1.0], {})[1:] == []
    assert rule_of([(-math.inf, math.inf)], [9.0], {0: [1.0]})[1:] == []
