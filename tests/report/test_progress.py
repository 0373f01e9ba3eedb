import io
from dataclasses import replace

import pytest
from rich.console import Console
from sweeps_for_tests import config, refinement, refiner_config, skipped

from ge_torchrl.records import GenerationRecord
from ge_torchrl.report.progress import Progress
from ge_torchrl.sections import HallOfFameConfig


def record(generation, best, **changes):
    values = {
        "generation": generation,
        "best_fitness": best,
        "best_refined": None,
        "median_fitness": 9.4,
        "mean_fitness": 20.0,
        "best_decision_nodes": 2,
        "born": 10,
        "invalid": 1,
        "env_steps": 1_000_000 * (generation + 1),
        "elapsed_seconds": 0.5 * (generation + 1),
        "evaluation_seconds": 0.4,
        "variation_seconds": 0.1,
    }
    return GenerationRecord(**{**values, **changes})


def shown(records, generations, *, terminal):
    output = io.StringIO()
    console = Console(
        file=output, force_terminal=terminal, width=100, color_system=None, legacy_windows=False
    )
    with Progress(console, generations) as progress:
        for one in records:
            progress.show(one)
    return output.getvalue()


def told(records, settings):
    """Return the lines of refinements on plain output."""
    output = io.StringIO()
    with Progress(Console(file=output, width=100), settings.ge.generations, config=settings) as progress:
        for one in records:
            progress.show_refinement(one)
    return output.getvalue().splitlines()[1:]


def test_plain_lines_are_few_and_tell_the_last_generation():
    lines = shown([record(g, float(g)) for g in range(240)], 240, terminal=False).splitlines()
    assert lines[0].split() == [
        "generation",
        "best",
        "median",
        "splits",
        "of",
        "best",
        "env",
        "steps/s",
        "time",
        "left",
    ]
    assert 10 <= len(lines) <= 15
    assert lines[1].split() == ["0", "0.00", "9.40", "2", "2.0", "M", "2:00"]
    assert lines[-1].split() == ["239", "239.00", "9.40", "2", "2.0", "M", "0:00"]


def test_a_short_run_shows_every_generation_once():
    lines = shown([record(g, 1.0) for g in range(3)], 3, terminal=False).splitlines()
    assert [line.split()[0] for line in lines[1:]] == ["0", "1", "2"]


def test_a_terminal_gets_a_live_table_that_ends_with_the_last_generation():
    text = shown([record(g, float(g // 10)) for g in range(50)], 100, terminal=True)
    # The last drawing overwrites the earlier ones.
    final = text[text.rindex("generation ") - 600 :]
    assert "49" in final
    assert "50 of 100 generations" in final


def test_a_population_without_any_tree_shows_dashes():
    empty = record(0, None, median_fitness=None, mean_fitness=None, best_decision_nodes=None)
    line = shown([empty], 1, terminal=False).splitlines()[1]
    assert line.split()[:4] == ["0", "-", "-", "-"]


BROKEN = refinement(40, outcome="failed", failure="the loss is not finite in update 3", new_best=False)


def test_refinements_are_short_lines_named_after_their_method():
    records = [
        refinement(40, decision_nodes=2, again=10.04, after=10.14, new_best=False, refine_seconds=10.04),
        refinement(80, chosen="best", decision_nodes=1, again=500.0, after=480.0, new_best=False),
        refinement(120, again=-115.7, after=-110.14, new_best=True),
        BROKEN,
        skipped(160),
    ]
    assert told(records, config(refiner="ppo")) == [
        "generation 40  PPO: random tree of 2 nodes, 10.04 -> 10.14 on unseen episodes, improved, 10.0 s",
        "generation 80  PPO: best tree of 1 node, 500.00 -> 480.00 on unseen episodes, not improved, 1.0 s",
        "generation 120  PPO: random tree of 3 nodes, -115.70 -> -110.14 on unseen episodes, new best, 1.0 s",
        "generation 40  PPO: random tree of 3 nodes kept as it was, the loss is not finite in update 3, 1.0 s",
        "generation 160  PPO: skipped, no candidate in 20 redraws",
    ]
    (line,) = told(records[:1], config(refiner="cmaes"))
    assert line.startswith("generation 40  CMA-ES: ")


@pytest.mark.parametrize(
    ("changes", "shows_all"),
    [
        ({"every": 15}, False),  # 13 generations are due in 200, the last being 195.
        ({"every": 16}, True),
        ({"every": 40, "candidates": 4}, False),
        ({"every": 1, "probability": 0.05}, True),
    ],
)
def test_of_many_refinements_only_new_bests_and_failures_are_shown(changes, shows_all):
    news = [refinement(15, new_best=True), BROKEN]
    settings = replace(config(), refiner=refiner_config("cmaes", **changes))
    shown_lines = told([*news, refinement(30, new_best=False), skipped(45)], settings)
    assert len(shown_lines) == (4 if shows_all else 2)


def test_explored_trees_are_counted_where_there_will_be_any():
    def lines(hall_of_fame, refiner="cmaes"):
        output = io.StringIO()
        settings = config(refiner=refiner, generations=2, hall_of_fame=hall_of_fame)
        with Progress(Console(file=output, width=100), 2, config=settings) as progress:
            progress.show(record(0, 1.0))
            progress.show(record(1, 1.0, explored=1593))
        return [line.split()[-2:] for line in output.getvalue().splitlines()]

    exploring = HallOfFameConfig(enabled=True, neighbours=26)
    assert lines(exploring) == [["left", "explored"], ["0:00", "0"], ["0:00", "1,593"]]
    for settings, refiner in (
        (HallOfFameConfig(enabled=True), "cmaes"),
        (HallOfFameConfig(), "cmaes"),
        (HallOfFameConfig(enabled=True), "none"),
    ):
        assert lines(settings, refiner)[0] == ["time", "left"]


def test_a_terminal_counts_explored_trees_too():
    output = io.StringIO()
    console = Console(file=output, force_terminal=True, width=100, color_system=None, legacy_windows=False)
    settings = config(refiner="cmaes", hall_of_fame=HallOfFameConfig(enabled=True, revisits=1))
    with Progress(console, 200, config=settings) as progress:
        progress.show(record(0, 1.0, explored=26))
    assert "explored" in output.getvalue()
