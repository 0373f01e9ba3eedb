"""Testing the trees of runs again."""

import json

import numpy as np
import pytest
from records_for_tests import kept
from sweeps_for_tests import PRUNED, chain, controller, leaf, split, write_run

from ge_torchrl.environments.choose import open_backend
from ge_torchrl.environments.spec import describe
from ge_torchrl.errors import ArtefactError
from ge_torchrl.report import evaluation
from ge_torchrl.report.evaluation import evaluate, evaluate_runs, is_above_runs
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.controller import Controller, Names
from ge_torchrl.trees.files import write_controller
from ge_torchrl.trees.forest import Forest


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("run") / "run", seed=3)


class TestEvaluation:
    def test_a_run_and_its_tree_file_give_the_same(self, finished):
        folder = finished
        assert evaluate(folder, 50, 0) == evaluate(folder / "best_tree.json", 50, 0)

    def test_routes_agree_and_seeds_count_up(self, finished):
        tree = finished / "best_tree.json"
        whole = evaluate(tree, 6, 100, "kernel")
        parts = [evaluate(tree, 3, 100, "gymnasium"), evaluate(tree, 3, 103, "gymnasium")]
        assert whole.mean == pytest.approx(np.mean([part.mean for part in parts]))
        assert (whole.min, whole.max) == (min(p.min for p in parts), max(p.max for p in parts))

    def test_summary_as_json_and_text(self, finished):
        summary = evaluate(finished, 10, 7)
        values = summary.as_dict()
        assert values.keys() >= {"mean", "std", "min", "max", "episodes", "solved"}
        assert json.loads(json.dumps(values)) == values
        assert "over 10 episodes" in summary.as_text()
        assert "seeds 7 to 16" in summary.as_text()

    def test_a_tree_of_the_archive_is_chosen_by_its_size(self, tmp_path):
        folder = write_run(tmp_path / "run", archive=[kept(1, 0.0), kept(4, 0.0)])
        chosen = evaluate(folder, 50, 0, nodes=4)
        assert chosen.decision_nodes == 4
        assert chosen == evaluate(folder / "archive" / "04.json", 50, 0)
        with pytest.raises(ArtefactError, match="expected a run's folder"):
            evaluate(folder / "best_tree.json", 1, 0, nodes=4)

    def test_an_unfinished_run_has_a_tree_too(self, tmp_path):
        folder = write_run(tmp_path / "run")
        whole = evaluate(folder, 50, 0)
        (folder / "summary.json").unlink()
        assert evaluate(folder, 50, 0) == whole

    def test_a_tree_file_alone_brings_its_environment(self, tmp_path):
        write_controller(tmp_path / "tree.json", controller(PRUNED))
        alone = evaluate(tmp_path / "tree.json", 50, 0)
        assert (alone.environment, alone.solved_at) == ("CartPole-v1", 475.0)

    def test_a_goal_that_asks_for_speed_is_not_measured_by_the_plain_kernel(self, tmp_path):
        # Pushing along the velocity arrives after 122, 124, 116, 114 and 122 steps, and is slower than asked for.
        tree = split(1, 0.0, leaf(0), leaf(2))
        means = {}
        for kwargs in ({}, {"goal_velocity": 0.05}):
            names = Names("MountainCar-v0", ("x0", "x1"), ("", ""), ("a0", "a1", "a2"), kwargs)
            write_controller(tmp_path / "tree.json", Controller(tree, names))
            measured = evaluate(tmp_path / "tree.json", 5, 0)
            means[measured.route] = measured.mean
        assert means == {"kernel": pytest.approx(-119.6), "gymnasium": pytest.approx(-123.6)}

    def test_a_raised_limit_travels_with_the_file(self, tmp_path):
        # It drives left for ever.
        names = Names("MountainCar-v0", ("x0", "x1"), ("", ""), ("a0", "a1", "a2"), max_episode_steps=1000)
        write_controller(tmp_path / "tree.json", Controller(leaf(0), names))
        assert evaluate(tmp_path / "tree.json", 3, 0).mean == -1000.0
        elsewhere = write_run(tmp_path / "run", environment="MountainCar-v0") / "best_tree.json"
        (tmp_path / "tree.json").replace(elsewhere)
        assert evaluate(elsewhere, 3, 0).mean == -1000.0

    def test_missing_trees_are_named(self, tmp_path):
        with pytest.raises(ArtefactError, match="nowhere"):
            evaluate(tmp_path / "nowhere.json", 1, 0)
        with pytest.raises(ArtefactError, match=r"best_tree\.json"):
            evaluate(tmp_path, 1, 0)


class TestManyRuns:
    EPISODES = np.arange(1_000_000, 1_000_020)
    VALIDATION = episode_seeds("validation", 20, stream(1_000_000, "episodes that choose among runs"))

    @pytest.fixture
    def sweep(self, tmp_path):
        """CartPole by two methods with archives, and Acrobot without one; a broken run besides."""
        folder = tmp_path / "sweep"
        for seed, sizes in ((3, (1, 2, 5)), (1, (1, 2))):
            archive = [kept(size, 0.0) for size in sizes]
            write_run(folder / "deep" / f"{seed}", "GE+CMA-ES", seed=seed, archive=archive)
        write_run(folder / "ge", seed=7, wall_seconds=12.5)
        write_run(folder / "other", seed=0, environment="Acrobot-v1", solved_at=-100.0)
        (write_run(folder / "broken") / "best_tree.json").write_text("{")
        return folder

    def returns_of(self, tree, episodes=EPISODES):
        backend = open_backend(describe("CartPole-v1"), "kernel")
        try:
            return backend.evaluate(Forest.stack([tree]), episodes, "test").returns[0]
        finally:
            backend.close()

    def test_runs_are_found_at_any_depth_and_come_by_environment_method_and_seed(self, sweep):
        found = evaluate_runs(sweep, 20, 1_000_000)
        assert [
            (one.environment, one.method, [each.row.seed for each in one.runs]) for one in found.methods
        ] == [
            ("Acrobot-v1", "GE", [0]),
            ("CartPole-v1", "GE+CMA-ES", [1, 3]),
            ("CartPole-v1", "GE", [7]),
        ]
        (line,) = found.left_out
        assert line.startswith(f"{sweep / 'broken'}: ")

    def test_runs_of_different_settings_are_never_averaged_together(self, tmp_path):
        for seed, generations in enumerate((100, 100, 200)):
            write_run(tmp_path / str(seed), seed=seed, settings={"generations": generations})
        found = evaluate_runs(tmp_path, 5, 0, "kernel")
        assert [(one.setting, [run.row.seed for run in one.runs]) for one in found.methods] == [
            ("ge.generations=100", [0, 1]),
            ("ge.generations=200", [2]),
        ]
        assert "CartPole-v1 GE, ge.generations=100 (5 episodes" in found.as_text()
        assert found.as_dict()["methods"][1]["setting"] == "ge.generations=200"

    def test_champions_and_trees_of_each_size_are_measured_on_the_same_episodes(self, sweep):
        _, cmaes, ge = evaluate_runs(sweep, 20, 1_000_000, "kernel").methods
        champion = self.returns_of(PRUNED)
        for row in (one.row for one in (*cmaes.runs, *ge.runs)):
            assert (row.mean, row.std, row.decision_nodes) == (champion.mean(), champion.std(), 2)
        assert [tree.decision_nodes for tree in cmaes.runs[1].by_size] == [1, 2, 5]
        for tree in cmaes.runs[1].by_size:
            assert tree.mean == self.returns_of(chain(tree.decision_nodes)).mean()
        assert (ge.runs[0].row.wall_seconds, ge.runs[0].by_size) == (12.5, ())

    def test_runs_compete_on_validation_episodes_that_they_share(self, tmp_path):
        # The pole falls at once under the second tree, whose run saw luckier episodes.
        trees = {1: split(2, 0.0, leaf(0), leaf(1)), 2: split(2, 0.0, leaf(1), leaf(0))}
        for (seed, tree), own in zip(trees.items(), (10.0, 400.0), strict=True):
            archive = [kept(1, 0.0, validation_mean=own)]
            folder = write_run(tmp_path / f"{seed}", "GE+CMA-ES", seed=seed, archive=archive)
            write_controller(folder / "archive" / "01.json", controller(tree))
        (method,) = evaluate_runs(tmp_path, 20, 1_000_000).methods
        for found in method.runs:
            (tree,) = found.by_size
            assert tree.validation_mean == self.returns_of(trees[found.row.seed], self.VALIDATION).mean()
        assert [size.in_validation.seed for size in method.sizes] == [1]

    def test_one_call_measures_all_trees_of_an_environment_each_once(self, sweep, monkeypatch):
        sizes = []

        def counting(spec, route):
            opened = open_backend(spec, route)
            measure = opened.evaluate

            def evaluate(forest, seeds, purpose):
                sizes.append((spec.id, len(forest), list(seeds), purpose))
                return measure(forest, seeds, purpose)

            opened.evaluate = evaluate
            return opened

        monkeypatch.setattr(evaluation, "open_backend", counting)
        evaluate_runs(sweep, 20, 1_000_000)
        test, validation = list(self.EPISODES), list(self.VALIDATION)
        # Acrobot's run kept no archive, so there is nothing to choose.
        assert sizes == [
            ("Acrobot-v1", 1, test, "test"),
            ("CartPole-v1", 4, test, "test"),
            ("CartPole-v1", 3, validation, "validation"),
        ]

    def test_runs_of_one_method_agree_with_single_evaluations(self, finished):
        folder = finished
        (method,) = evaluate_runs(folder.parent, 50, 0).methods
        single = evaluate(folder, 50, 0)
        (only,) = method.runs
        assert (only.row.mean, only.row.std, only.row.solved) == (single.mean, single.std, single.solved)
        assert method.solved == int(single.solved)

    def test_a_size_restricts_to_the_runs_that_have_it(self, sweep):
        found = evaluate_runs(sweep, 20, 1_000_000, nodes=5)
        ((only,),) = [one.runs for one in found.methods]
        (tree,) = only.by_size
        assert (only.row.seed, only.row.decision_nodes, tree.decision_nodes) == (3, 5, 5)
        assert (only.row.mean, only.row.std) == (tree.mean, tree.std)
        assert [line.partition(": ")[2] for line in found.left_out[1:]] == [
            "it has no tree with 5 decision nodes"
        ] * 3

    def test_sizes_that_no_run_has_are_mistakes(self, sweep, finished):
        with pytest.raises(ArtefactError, match=r"must be one of 1, 2, 5, because the archives in .*; got 9"):
            evaluate_runs(sweep, 1, 0, nodes=9)
        with pytest.raises(ArtefactError, match="must hold archives"):
            evaluate_runs(finished.parent, 1, 0, nodes=9)

    def test_a_folder_without_runs_is_a_mistake(self, tmp_path):
        with pytest.raises(ArtefactError, match="expected a folder with finished runs; found none in"):
            evaluate_runs(tmp_path, 1, 0)
        (write_run(tmp_path / "broken") / "config.yaml").write_text("seed: -1")
        with pytest.raises(ArtefactError, match=r"found none in .*; .*broken: "):
            evaluate_runs(tmp_path, 1, 0)

    def test_only_a_folder_that_is_no_run_is_above_runs(self, sweep):
        assert is_above_runs(sweep)
        assert is_above_runs(sweep / "deep")
        assert not is_above_runs(sweep / "ge")
        assert not is_above_runs(sweep / "ge" / "best_tree.json")
        assert not is_above_runs(sweep / "nowhere")
