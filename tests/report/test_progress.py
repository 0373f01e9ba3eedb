import io

from rich.console import Console

from ge_torchrl.records import GenerationRecord
from ge_torchrl.report.progress import Progress


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
