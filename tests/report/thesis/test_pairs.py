import numpy as np
import pytest
from records_for_tests import history
from sweeps_for_tests import NO_ARCHIVE, write_run

from ge_torchrl.report.runs import read_run, read_runs
from ge_torchrl.report.thesis.pairs import (
    Pair,
    comparison_text,
    pair_by_seed,
    telling_pairs,
    unequal_sections,
)

SLOW, FAST, NEVER = [9.0] * 9 + [480.0], [9.0] * 4 + [480.0] * 6, [9.0] * 10


def rng():
    return np.random.default_rng(0)


def pairs_in(folder, method="GE+PPO"):
    return pair_by_seed(read_runs(folder).runs, method)


def test_pairs_are_of_one_seed_and_of_several_runs_the_first(tmp_path):
    for name, method, seed in [
        ("a", "GE", 0),
        ("b", "GE+PPO", 0),
        ("c", "GE+PPO", 0),
        ("d", "GE", 1),
        ("e", "GE+PPO", 2),
        ("f", "GE+CMA-ES", 1),
    ]:
        write_run(tmp_path / name, method, seed=seed)
    pairs = pairs_in(tmp_path)
    assert [(pair.treated.path.name, pair.plain.path.name) for pair in pairs] == [("b", "a")]
    (other,) = pairs_in(tmp_path, "GE+CMA-ES")
    assert (other.treated.path.name, other.plain.path.name, other.method) == ("f", "d", "GE+CMA-ES")
    assert unequal_sections(pairs) == ()
    assert pairs_in(tmp_path, "GE") == ()


def test_the_control_is_the_run_whose_settings_are_most_alike(tmp_path):
    """The thesis selects without parsimony, and so does its control, which lies beside that of the default."""
    write_run(tmp_path / "a")
    write_run(tmp_path / "b", settings={"parsimony": "none", "archive": NO_ARCHIVE})
    write_run(tmp_path / "c", "thesis")
    (pair,) = pairs_in(tmp_path, "thesis")
    assert (pair.plain.path.name, unequal_sections([pair])) == ("b", ())


def test_pairs_that_differ_in_more_than_what_is_added_are_noticed(tmp_path):
    write_run(tmp_path / "a", "GE+PPO")
    write_run(tmp_path / "b", generations=history([9.0] * 3))
    assert unequal_sections(pairs_in(tmp_path)) == ("ge",)


def test_what_was_measured_or_only_costs_time_makes_no_pair_unequal(tmp_path):
    treated = write_run(tmp_path / "a", "GE+PPO")
    write_run(tmp_path / "b")
    text = (treated / "config.yaml").read_text()
    for before, after in (
        ("threads: 0", "threads: 2"),
        ("steps_per_second: 100000000.0", "steps_per_second: 2.0e+8"),
    ):
        assert before in text
        text = text.replace(before, after)
    (treated / "config.yaml").write_text(text)
    assert unequal_sections(pairs_in(tmp_path)) == ()


def test_telling_pairs_are_those_that_save_most_in_the_order_of_seeds(tmp_path):
    pairs = []
    for seed in range(4):
        fast = history([9.0] * (seed + 1) + [500.0])
        treated = write_run(tmp_path / "ppo" / str(seed), "GE+PPO", seed=seed, generations=fast)
        plain = write_run(tmp_path / "ge" / str(seed), seed=seed, generations=history([9.0] * 9 + [500.0]))
        pairs.append(Pair(read_run(treated), read_run(plain)))
    assert [pair.treated.seed for pair in telling_pairs(pairs[::-1], 475.0)] == [0, 1, 2]


def test_comparison_in_words(tmp_path):
    spent = {"env_steps": 3000, "steps": {"fitness": 2000, "refinement": 500, "polish": 400, "test": 100}}
    for seed, alone in ((0, SLOW), (1, NEVER)):
        treated = history(FAST, steps=4000)
        write_run(tmp_path / f"ppo{seed}", "GE+PPO+polish", seed=seed, generations=treated, **spent)
        write_run(tmp_path / f"ge{seed}", seed=seed, generations=history(alone), env_steps=1000)
    assert comparison_text(pairs_in(tmp_path, "GE+PPO+polish"), 475.0, rng()) == (
        "| seed | GE+PPO+polish | GE alone | ratio | env steps, GE+PPO+polish | GE alone | ratio |\n"
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |\n"
        "| 0 | 5 | 10 | 0.50 | 20,000 | 10,000 | 2.00 |\n"
        "| 1 | 5 | > 10 | 0.50 | 20,000 | > 10,000 | 2.00 |\n"
        "\n"
        "* Median ratio of generations: 0.50 (range 0.50 to 0.50). By the median, GE+PPO+polish is faster, but 2 "
        "pairs show little.\n"
        "* Median ratio of environment steps, those of refinement included: 2.00 (range 2.00 to 2.00). By the "
        "median, GE+PPO+polish takes more, but 2 pairs show little.\n"
        "* Never reached: 0 of 2 with PPO and polish, 1 of 2 without, 0 in both. Such a run counts as all that it "
        "took, a lower bound.\n"
        "* In environment steps, a whole search took 3,000 with PPO and polish, 500 of them in refinement, 400 of "
        "them in polish, and 1,000 without."
    )


def test_comparison_names_the_method(tmp_path):
    write_run(tmp_path / "a", "GE+CMA-ES")
    write_run(tmp_path / "b")
    text = comparison_text(pairs_in(tmp_path, "GE+CMA-ES"), 475.0, rng())
    assert "| seed | GE+CMA-ES | GE alone | ratio |" in text
    assert "By the median, GE+CMA-ES is as fast, but one pair shows little." in text
    assert "a whole search took 10 with CMA-ES, and 10 without." in text
    assert "PPO" not in text


@pytest.mark.parametrize("extra", [0, 2])
def test_comparison_doubts_itself(tmp_path, extra):
    for seed, with_ppo, alone in ((0, 2, 8), (1, 9, 3), (2, 4, 5), (3, 1, 4), (4, 8, 2)):
        for method, solved, length in (("GE+PPO", with_ppo, 10 + extra), ("GE", alone, 10)):
            best = [9.0] * (solved - 1) + [500.0] * (length - solved + 1)
            write_run(tmp_path / f"{method}{seed}", method, seed=seed, generations=history(best))
    text = comparison_text(pairs_in(tmp_path), 475.0, rng())
    assert (
        "* Median ratio of generations: 0.80 (0.25 to 4.00). By the median, GE+PPO is faster, but the interval "
        "does not exclude 1.\n" in text
    )
    assert text.endswith("* Mind that the runs of a pair differ in more than that: ge.") == bool(extra)
