from dataclasses import replace

import pytest
from records_for_tests import history, kept, refinement
from sweeps_for_tests import CARTPOLE, FULL, PRUNED, write_run

from ge_torchrl.errors import ArtefactError
from ge_torchrl.report.findings import overview_table
from ge_torchrl.report.runs import best_run, gather_runs, read_run, read_runs
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.files import write_controller


def test_a_run_is_read_in_full(tmp_path):
    records, archive = [refinement(40)], [kept(1, 9.0), kept(3, 480.0)]
    run = read_run(
        write_run(
            tmp_path / "run",
            "GE+PPO",
            seed=3,
            generations=history([9.0]),
            refinements=records,
            archive=archive,
        )
    )
    assert (run.method, run.environment, run.seed) == ("GE+PPO", "CartPole-v1", 3)
    assert (list(run.history), list(run.refinements), list(run.archive)) == (history([9.0]), records, archive)
    assert (run.pruned.tree, run.full.tree) == (PRUNED, FULL)
    assert [(tree.decision_nodes, tree.is_champion) for tree in run.by_size] == [(1, False), (3, True)]


def test_a_run_without_a_refiner_needs_no_refinements(tmp_path):
    path = write_run(tmp_path / "run", "GE+polish")
    assert not (path / "refinements.jsonl").exists()
    run = read_run(path)
    assert (run.method, run.refinements) == ("GE+polish", ())


def test_runs_come_by_environment_then_method_then_seed(tmp_path):
    for number, (environment, method, seed) in enumerate(
        [
            ("CartPole-v1", "GE", 1),
            ("CartPole-v1", "GE+CMA-ES", 0),
            ("CartPole-v1", "GE+PPO", 10),
            ("CartPole-v1", "GE+PPO", 9),
            ("CartPole-v1", "thesis", 3),
            ("CartPole-v1", "GE+PPO+polish", 3),
            ("Acrobot-v1", "GE", 0),
        ]
    ):
        write_run(tmp_path / "deep" / str(number), method, seed=seed, environment=environment)
    runs, unreadable, _ = read_runs(tmp_path)
    assert [(run.environment, run.method, run.seed) for run in runs] == [
        ("Acrobot-v1", "GE", 0),
        ("CartPole-v1", "thesis", 3),
        ("CartPole-v1", "GE+PPO+polish", 3),
        ("CartPole-v1", "GE+PPO", 9),
        ("CartPole-v1", "GE+PPO", 10),
        ("CartPole-v1", "GE+CMA-ES", 0),
        ("CartPole-v1", "GE", 1),
    ]
    assert unreadable == ()


def test_runs_of_one_id_made_otherwise_are_of_another_environment(tmp_path):
    for number, made in enumerate([{}, {"kwargs": {"gravity": 1.6}}, {}, {"max_episode_steps": 900}]):
        path = write_run(tmp_path / str(number), seed=number)
        write_controller(path / "best_tree.json", Controller(PRUNED, replace(CARTPOLE, **made)))
    runs = read_runs(tmp_path).runs
    assert [(run.environment, run.seed) for run in runs] == [
        ("CartPole-v1", 0),
        ("CartPole-v1", 2),
        ("CartPole-v1 (900 steps)", 3),
        ("CartPole-v1 (gravity=1.6)", 1),
    ]
    told = overview_table(runs)
    assert "CartPole-v1 (gravity=1.6) GE" in told


@pytest.mark.parametrize(
    "name", ["config.yaml", "history.jsonl", "summary.json", "best_tree.json", "best_tree_full.json"]
)
def test_a_run_with_an_unreadable_file_is_named_and_left_out(tmp_path, name):
    write_run(tmp_path / "whole")
    broken = write_run(tmp_path / "broken")
    (broken / name).write_text("{")
    runs, (line,), _ = read_runs(tmp_path)
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


def test_against_adds_only_what_is_lacking(tmp_path):
    for seed in range(2):
        write_run(tmp_path / "ge" / str(seed), seed=seed)
        write_run(tmp_path / "ppo" / str(seed), "GE+PPO", seed=seed)
    write_run(tmp_path / "ge" / "other", environment="Acrobot-v1")
    runs = gather_runs(tmp_path / "ppo", tmp_path).runs
    assert [(run.environment, run.method) for run in runs] == [
        *[("CartPole-v1", "GE+PPO")] * 2,
        *[("CartPole-v1", "GE")] * 2,
    ]
    with pytest.raises(ArtefactError, match=r"those in .*ppo are of CartPole-v1 GE\+PPO"):
        gather_runs(tmp_path / "ppo", tmp_path / "ppo")


def test_the_best_run_is_that_of_validation_then_the_simplest(tmp_path):
    runs = [
        read_run(
            write_run(tmp_path / name, validation_mean=validation, test_mean=test, complexity_M=complexity)
        )
        for name, validation, test, complexity in [
            ("a", 490.0, 500.0, 17.8),
            ("b", 499.0, 480.0, 53.4),
            ("c", 499.0, 470.0, 35.6),
        ]
    ]
    assert best_run(runs).path.name == "c"


def test_a_folder_of_unfinished_runs_alone_says_so(tmp_path):
    for name in ("a", "b"):
        (write_run(tmp_path / name, "GE") / "summary.json").unlink()
    with pytest.raises(ArtefactError) as told:
        read_runs(tmp_path)
    assert str(told.value) == (
        f"expected a folder with finished runs; found none in {tmp_path}, but {tmp_path / 'a'}, and 1 more, without "
        f"summary.json: a run that goes on, or broke off; report {tmp_path / 'a'} tells what it has found so far"
    )
