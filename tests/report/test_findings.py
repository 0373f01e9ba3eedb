import numpy as np
import pytest
from sweeps_for_tests import history, refinement, skipped, write_run

from ge_torchrl.report.findings import (
    comparison_text,
    method_text,
    overview_table,
    refinements_text,
    runs_tables,
)
from ge_torchrl.report.runs import pair_by_seed, read_runs

UNSOLVED = {"solved": False, "test_mean": 100.0}


def rng():
    return np.random.default_rng(0)


@pytest.fixture
def runs(tmp_path):
    slow, fast = [9.0] * 9 + [480.0], [9.0] * 4 + [480.0] * 6
    never = [9.0] * 10
    with_ppo = {"refiner": "ppo", "env_steps": 3000}
    write_run(tmp_path / "a", seed=0, generations=history(slow), env_steps=1000)
    write_run(tmp_path / "b", seed=1, generations=history(never), env_steps=1000, **UNSOLVED)
    write_run(
        tmp_path / "c",
        seed=0,
        generations=history(fast, steps=4000),
        refinements=[refinement(2, timesteps=500, return_snapped=470.0, written_back=True), skipped(4)],
        champion_from="refinement",
        **with_ppo,
    )
    write_run(
        tmp_path / "d",
        seed=1,
        generations=history(fast, steps=4000),
        refinements=[refinement(2, before=9.0, again=9.0, after=9.0, timesteps=500, new_best=False)],
        **with_ppo,
    )
    return read_runs(tmp_path).runs


def of(method, runs):
    return [run for run in runs if run.method == method]


def test_overview_puts_the_thesis_beside_ge_with_ppo_only(runs):
    assert overview_table(runs).splitlines()[2:] == [
        "| CartPole-v1 GE+PPO | 2 | 2 of 2 (34% to 100%) | 9 of 10 | 487.40 | 465.17 | 53.4 | 48.1 |",
        "| CartPole-v1 GE | 2 | 1 of 2 (9% to 91%) |  | 293.70 |  | 53.4 |  |",
    ]


def test_tables_of_runs_name_methods_only_where_there_are_both(runs):
    both = runs_tables(runs)
    assert both.index("**CartPole-v1 GE+PPO**") < both.index("**CartPole-v1 GE**")
    assert runs_tables(of("GE", runs)).startswith("**CartPole-v1** (")


def test_a_method_in_words(runs):
    text = method_text(of("GE", runs), rng())
    assert "| 1 | 500.00 | 100.00 | 53.4 | no |" in text
    assert text.splitlines()[-4:] == [
        "* Solved: 1 of 2 (9% to 91%).",
        "* Mean training fitness: 500.00 (500.00 to 500.00).",
        "* Mean test return: 293.70 (100.00 to 487.40). The training fitness is 206.30 above it on average.",
        "* Mean complexity M: 53.40 (53.40 to 53.40).",
    ]


@pytest.mark.parametrize(("refiner", "method"), [("none", "GE"), ("cmaes", "GE+CMA-ES")])
def test_the_numbers_of_the_thesis_stand_beside_ge_with_ppo_alone(runs, tmp_path, refiner, method):
    text = method_text(of("GE+PPO", runs), rng())
    assert "| R2 | 1 | 500.00 | 234.80 | 487.40 | 199.71 | 53.4 | 35.6 | yes | no |" in text
    assert "Thesis: Table 4.3. A seed does not make the same run in two programs" in text
    write_run(tmp_path / "other" / "a", refiner=refiner, refinements=[refinement(2)])
    others = read_runs(tmp_path / "other").runs
    assert others[0].method == method
    assert "hesis" not in method_text(others, rng())
    assert "hesis" not in overview_table(others)
    if method != "GE":
        assert "Thesis:" not in refinements_text(others)


def test_an_environment_without_threshold_and_thesis(tmp_path):
    write_run(tmp_path / "a", environment="Any-v0", solved=None, solved_at=None)
    (run,) = read_runs(tmp_path).runs
    text = method_text([run], rng())
    assert "olved:" not in text
    assert "hesis" not in text
    assert "* Mean test return: 487.40. The" in text, "one run gives no interval"
    assert overview_table([run]).splitlines()[-1] == "| Any-v0 GE | 1 |  | 487.40 | 53.4 |"


def test_seeds_that_stand_twice_are_noticed(tmp_path):
    write_run(tmp_path / "a")
    write_run(tmp_path / "b")
    assert "* Some seeds stand more than once" in method_text(read_runs(tmp_path).runs, rng())


def test_refinements_in_words(runs):
    assert refinements_text(of("GE+PPO", runs)) == (
        "| applications of PPO | of 2 |\n"
        "| --- | ---: |\n"
        "| return after > fitness before, as the thesis counts | 1 |\n"
        "| return after > return before, on the same unseen episodes | 1 |\n"
        "| best of its generation | 1 |\n"
        "| written back into the population | 1 |\n"
        "| some threshold moved | 2 |\n"
        "| some leaf changed its action | 2 |\n"
        "| training broke off | 0 |\n"
        "\n"
        "* Mean loss of each bridge, of the 1 tree with all returns known: -280.00 in hardening (soft 200.00 -> "
        "480.00), 10.00 in snapping to the grammar's constants (480.00 -> 470.00). Before, they returned 90.00.\n"
        "* The champion is a refined tree in 1 of 2 runs. A tree that was written back counts as one of the "
        "population.\n"
        "* 1 more was skipped, as no tree could be a candidate.\n"
        "* Thesis: 29 of 40 improved the tree, 4 of them to the highest possible return."
    )


def test_refinements_without_gradients_in_words(tmp_path):
    explored = {"explored": 1500, "explore_seconds": 40.0}
    for seed, champion_from in enumerate(("neighbour", "population")):
        write_run(
            tmp_path / str(seed),
            seed=seed,
            refiner="cmaes",
            refinements=[refinement(2, soft_return=None, return_snapped=480.0)],
            champion_from=champion_from,
            **explored,
        )
    text = refinements_text(read_runs(tmp_path).runs)
    assert text.startswith("| applications of CMA-ES | of 2 |\n")
    assert text.splitlines()[-3:] == [
        (
            "* Mean loss of each bridge, of the 2 trees with all returns known: 0.00 in snapping to the grammar's "
            "constants (480.00 -> 480.00). Before, they returned 90.00."
        ),
        "* The champion is a refined tree in 0 of 2 runs, and a tree refined in exploring in 1.",
        "* Besides, 3,000 trees were refined in exploring from the hall of fame, 1,500 a run in 40.0 s.",
    ]


def test_comparison_in_words(runs):
    assert comparison_text(pair_by_seed(runs), 475.0, rng()) == (
        "| seed | GE+PPO | GE alone | ratio | env steps, GE+PPO | GE alone | ratio |\n"
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |\n"
        "| 0 | 5 | 10 | 0.50 | 20,000 | 10,000 | 2.00 |\n"
        "| 1 | 5 | > 10 | 0.50 | 20,000 | > 10,000 | 2.00 |\n"
        "\n"
        "* Median ratio of generations: 0.50 (0.50 to 0.50). By the median, GE+PPO is faster.\n"
        "* Median ratio of environment steps, those of refinement included: 2.00 (2.00 to 2.00). By the median, "
        "GE+PPO takes more.\n"
        "* Never reached: 0 of 2 with PPO, 1 of 2 without, 0 in both. Such a run counts as all that it took, a lower "
        "bound.\n"
        "* In environment steps, a whole run took 3,000 with PPO, 500 of them in refining trees of its population, "
        "and 1,000 without."
    )


def test_comparison_names_the_method_and_its_exploring(tmp_path):
    write_run(tmp_path / "a", refiner="cmaes", explored=1500)
    write_run(tmp_path / "b")
    text = comparison_text(pair_by_seed(read_runs(tmp_path).runs, "GE+CMA-ES"), 475.0, rng())
    assert "| seed | GE+CMA-ES | GE alone | ratio |" in text
    assert "By the median, GE+CMA-ES is as fast, but one pair shows little." in text
    assert "0 of 1 with CMA-ES" in text
    assert "trees of its population and others in refining 1,500 trees of its hall of fame" in text
    assert "PPO" not in text


def test_comparison_doubts_itself(tmp_path):
    for seed, with_ppo, alone in ((0, 2, 8), (1, 9, 3), (2, 4, 5)):
        for refiner, solved in (("ppo", with_ppo), ("none", alone)):
            best = [9.0] * (solved - 1) + [500.0] * (10 if refiner == "none" else 12)
            write_run(tmp_path / f"{refiner}{seed}", seed=seed, refiner=refiner, generations=history(best))
    text = comparison_text(pair_by_seed(read_runs(tmp_path).runs), 475.0, rng())
    assert (
        "* Median ratio of generations: 0.80 (0.25 to 3.00). By the median, GE+PPO is faster, but the interval "
        "does not exclude 1.\n" in text
    )
    assert text.endswith("* Mind that the runs of a pair differ in more than refinement: ge.")
