import pytest
from sweeps_for_tests import FULL, PRUNED, history, refinement, write_run

from ge_torchrl.errors import ArtefactError
from ge_torchrl.report.runs import pair_by_seed, read_run, read_runs, unequal_sections


def test_a_run_is_read_in_full(tmp_path):
    records = [refinement(40)]
    run = read_run(
        write_run(tmp_path / "run", seed=3, refiner="ppo", generations=history([9.0]), refinements=records)
    )
    assert (run.method, run.environment, run.seed) == ("GE+PPO", "CartPole-v1", 3)
    assert (list(run.history), list(run.refinements)) == (history([9.0]), records)
    assert (run.pruned.tree, run.full.tree) == (PRUNED, FULL)
    assert run.solving_time(475.0).generations == 1


def test_a_run_of_ge_alone_needs_no_refinements(tmp_path):
    path = write_run(tmp_path / "run")
    (path / "refinements.jsonl").unlink(missing_ok=True)
    run = read_run(path)
    assert (run.method, run.refinements) == ("GE", ())


def test_runs_come_by_environment_then_method_then_seed(tmp_path):
    for number, (environment, refiner, seed) in enumerate(
        [
            ("CartPole-v1", "none", 1),
            ("CartPole-v1", "cmaes", 0),
            ("CartPole-v1", "ppo", 10),
            ("CartPole-v1", "ppo", 9),
            ("Acrobot-v1", "none", 0),
        ]
    ):
        write_run(tmp_path / "deep" / str(number), seed=seed, refiner=refiner, environment=environment)
    runs, unreadable = read_runs(tmp_path)
    assert [(run.environment, run.method, run.seed) for run in runs] == [
        ("Acrobot-v1", "GE", 0),
        ("CartPole-v1", "GE+PPO", 9),
        ("CartPole-v1", "GE+PPO", 10),
        ("CartPole-v1", "GE+CMA-ES", 0),
        ("CartPole-v1", "GE", 1),
    ]
    assert unreadable == ()


@pytest.mark.parametrize(
    "name", ["config.yaml", "history.jsonl", "summary.json", "best_tree.json", "best_tree_full.json"]
)
def test_a_run_with_an_unreadable_file_is_named_and_left_out(tmp_path, name):
    write_run(tmp_path / "whole")
    broken = write_run(tmp_path / "broken")
    (broken / name).write_text("{")
    runs, (line,) = read_runs(tmp_path)
    assert [run.path.name for run in runs] == ["whole"]
    assert line.startswith(f"{broken}: ")


def test_a_run_without_a_generation_is_left_out(tmp_path):
    write_run(tmp_path / "whole")
    write_run(tmp_path / "empty", generations=[])
    assert "at least one generation" in read_runs(tmp_path).unreadable[0]


def test_no_run_and_no_readable_run_are_errors(tmp_path):
    with pytest.raises(ArtefactError, match="found none in"):
        read_runs(tmp_path)
    broken = write_run(tmp_path / "broken")
    (broken / "config.yaml").unlink()
    with pytest.raises(ArtefactError, match=r"found none in .*config\.yaml"):
        read_runs(tmp_path)


def test_pairs_are_of_one_seed_and_of_several_runs_the_first(tmp_path):
    for name, refiner, seed in [
        ("a", "none", 0),
        ("b", "ppo", 0),
        ("c", "ppo", 0),
        ("d", "none", 1),
        ("e", "ppo", 2),
    ]:
        write_run(tmp_path / name, seed=seed, refiner=refiner)
    write_run(tmp_path / "f", seed=1, refiner="cmaes")
    runs = read_runs(tmp_path).runs
    pairs = pair_by_seed(runs)
    assert [(pair.refined.path.name, pair.plain.path.name) for pair in pairs] == [("b", "a")]
    (other,) = pair_by_seed(runs, "GE+CMA-ES")
    assert (other.refined.path.name, other.plain.path.name, other.method) == ("f", "d", "GE+CMA-ES")
    assert unequal_sections(pairs) == ()


def test_pairs_that_differ_in_more_than_refinement_are_noticed(tmp_path):
    write_run(tmp_path / "a", refiner="ppo")
    write_run(tmp_path / "b", generations=history([9.0] * 3))
    assert unequal_sections(pair_by_seed(read_runs(tmp_path).runs)) == ("ge",)
