"""Whole runs with refinement and with a hall of fame."""

import re
import subprocess
import sys

import pytest
from runs_for_tests import config, run, without_clock

from ge_torchrl.artefacts import RunFolder
from ge_torchrl.config import Config
from ge_torchrl.environments.choose import open_route
from ge_torchrl.environments.spec import describe
from ge_torchrl.errors import ArtefactError
from ge_torchrl.evaluation import evaluate
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.forest import Forest


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "run"
    summary, output = run(config(), folder)
    return folder, summary, output


class TestWithRefinement:
    REFINER = {  # noqa: RUF012
        "name": "little",
        "schedule": {"every": 3},
        "measuring_episodes": 5,
        "ppo": {"max_timesteps": 400, "update_timesteps": 200, "epochs": 2},
        "cmaes": {"max_timesteps": 20_000},
    }

    def run(self, folder, refiner=None, **changes):
        values = config(ge={"generations": 8, "population_size": 30}, **changes).as_mapping()
        return run(Config.from_mapping({**values, "refiner": {**self.REFINER, **(refiner or {})}}), folder)

    def test_refinements_are_recorded_shown_and_byte_identical_again(self, tmp_path):
        summary, output = self.run(tmp_path / "one")
        self.run(tmp_path / "two", evaluation={"threads": 2})
        records = RunFolder(tmp_path / "one").read_refinements()
        assert [record.generation for record in records] == [3, 6]
        assert summary.refinements == 2
        assert summary.refinements_improved == sum(record.outcome == "improved" for record in records)
        assert output.count("PPO:") == 2
        assert re.search(r"PPO +\d of 2 refinements improved their tree", output)
        for name in ("history.jsonl", "refinements.jsonl"):
            assert without_clock(tmp_path / "one" / name) == without_clock(tmp_path / "two" / name)
        for name in ("best_tree.json", "best_tree_full.json"):
            assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()

    def test_beyond_the_thesis_runs_are_byte_identical_again(self, tmp_path):
        """Law 6."""
        beyond = {
            "write_back": True,
            "candidates": 2,
            "acceptance_episodes": 5,
            "ppo": {**self.REFINER["ppo"], "snapshot_episodes": 5},
        }
        for threads in (1, 2):
            self.run(tmp_path / str(threads), beyond, evaluation={"threads": threads})
        one, two = tmp_path / "1", tmp_path / "2"
        assert len(RunFolder(one).read_refinements()) == 4
        for name in ("history.jsonl", "refinements.jsonl"):
            assert without_clock(one / name) == without_clock(two / name)
        assert (one / "best_tree_full.json").read_bytes() == (two / "best_tree_full.json").read_bytes()

    def test_the_rival_is_a_setting_and_byte_identical_again(self, tmp_path):
        """Law 6."""
        rival = {"method": "cmaes", "write_back": True}
        for threads in (1, 2):
            self.run(tmp_path / str(threads), rival, evaluation={"threads": threads})
        records = RunFolder(tmp_path / "1").read_refinements()
        assert [record.generation for record in records] == [3, 6]
        assert all(record.actor_loss is None and record.gradient_steps == 0 for record in records)
        for name in ("history.jsonl", "refinements.jsonl"):
            assert without_clock(tmp_path / "1" / name) == without_clock(tmp_path / "2" / name)

    def test_evolution_itself_is_the_same_with_and_without(self, tmp_path):
        self.run(tmp_path / "with")
        run(config(ge={"generations": 8, "population_size": 30}), tmp_path / "without")
        with_ppo, without = (RunFolder(tmp_path / name).read_history() for name in ("with", "without"))
        assert [r.best_fitness for r in with_ppo] == [r.best_fitness for r in without]
        assert not (tmp_path / "without" / "refinements.jsonl").exists()


HALL = {"enabled": True, "episodes": 20, "max_nodes": 6}


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hall") / "run"
    return folder, *run(config(hall_of_fame=HALL), folder)


class TestHallOfFame:
    def test_table_and_trees_tell_the_truth(self, kept):
        folder, _, _ = kept
        records = RunFolder(folder).read_hall_of_fame()
        sizes = [record.decision_nodes for record in records]
        assert sizes == sorted(set(sizes))
        assert {path.name for path in (folder / "hall_of_fame").iterdir()} == {f"{n:02}.json" for n in sizes}
        trees = [RunFolder(folder).read_hall_of_fame_tree(size).tree for size in sizes]
        route = open_route(describe("CartPole-v1"))
        outcomes = route.evaluate(Forest.stack(trees), episode_seeds("test", 20, stream(0, "test episodes")))
        route.close()
        for record, tree, returns in zip(records, trees, outcomes.returns, strict=True):
            assert (record.decision_nodes, record.depth) == (tree.n_decision_nodes, tree.depth)
            assert (record.test_mean, record.test_std) == (returns.mean(), returns.std())

    def test_the_champion_is_the_best_of_its_size_and_nobody_was_better_in_validation(self, kept):
        folder, summary, output = kept
        records = RunFolder(folder).read_hall_of_fame()
        (mine,) = [record for record in records if record.decision_nodes == summary.decision_nodes]
        assert (mine.test_mean, mine.validation_mean) == (summary.test_mean, summary.validation_mean)
        assert summary.validation_mean == max(record.validation_mean for record in records)
        assert (
            RunFolder(folder).read_hall_of_fame_tree(mine.decision_nodes).tree
            == RunFolder(folder).read_tree().tree
        )
        assert output.count("<- the champion") == 1
        assert re.search(
            rf"^ +{mine.decision_nodes}  .*{mine.test_mean:.2f} ± .*<- the champion", output, re.MULTILINE
        )

    def test_evolution_is_the_same_with_and_without(self, kept, finished):
        assert without_clock(kept[0] / "history.jsonl") == without_clock(finished[0] / "history.jsonl")
        assert kept[1].env_steps_total > finished[1].env_steps_total
        assert kept[1].validation_mean >= finished[1].validation_mean

    def test_the_same_bytes_on_two_threads(self, kept, tmp_path):
        run(config(hall_of_fame=HALL, evaluation={"threads": 2}), tmp_path / "two")
        for path in [*(kept[0] / "hall_of_fame").iterdir(), kept[0] / "hall_of_fame.jsonl"]:
            assert path.read_bytes() == (tmp_path / "two" / path.relative_to(kept[0])).read_bytes()

    def test_evaluate_takes_a_tree_by_its_size(self, kept):
        folder, summary, _ = kept
        size = RunFolder(folder).read_hall_of_fame()[0].decision_nodes
        assert evaluate(folder, 10, 0, nodes=size).decision_nodes == size
        assert evaluate(folder, 10, 0, nodes=summary.decision_nodes) == evaluate(folder, 10, 0)
        file = folder / "hall_of_fame" / f"{size:02}.json"
        assert evaluate(file, 10, 0) == evaluate(folder, 10, 0, nodes=size)

    def test_a_size_that_is_not_there_is_answered_with_those_that_are(self, kept, finished):
        sizes = ", ".join(str(record.decision_nodes) for record in RunFolder(kept[0]).read_hall_of_fame())
        with pytest.raises(ArtefactError, match=rf"one of {sizes}, because .*; got 99"):
            evaluate(kept[0], 1, 0, nodes=99)
        with pytest.raises(ArtefactError, match=r"hall_of_fame\.enabled=true"):
            evaluate(finished[0], 1, 0, nodes=3)
        with pytest.raises(ArtefactError, match="expected a run's folder"):
            evaluate(finished[0] / "best_tree.json", 1, 0, nodes=3)


EXPLORED = {
    "enabled": True,
    "episodes": 20,
    "max_nodes": 4,
    "neighbours": 4,
    "neighbours_drawn": 40,
    "revisits": 1,
    "revisit_factor": 2,
    "final_keep": 2,
    "final_factor": 2,
    "migrants": 5,
}
CMAES = {
    "name": "test",
    "method": "cmaes",
    "schedule": {"every": 2},
    "measuring_episodes": 5,
    "write_back": True,
    "simplify": True,
    "cmaes": {"max_timesteps": 20_000},
}


def explored(folder, threads=1, **hall):
    values = config(ge={"generations": 6, "population_size": 30}, evaluation={"threads": threads})
    settings = {**values.as_mapping(), "refiner": CMAES, "hall_of_fame": {**EXPLORED, **hall}}
    return run(Config.from_mapping(settings), folder)


@pytest.fixture(scope="module")
def one(tmp_path_factory):
    folder = tmp_path_factory.mktemp("explored") / "one"
    return folder, *explored(folder)


class TestExploring:
    def test_runs_are_byte_identical_on_two_threads(self, one, tmp_path):
        """Law 6."""
        folder, summary, output = one
        explored(tmp_path / "two", threads=2)
        for name in ("history.jsonl", "refinements.jsonl", "hall_of_fame.jsonl"):
            assert without_clock(folder / name) == without_clock(tmp_path / "two" / name)
        trees = [folder / name for name in ("best_tree.json", "best_tree_full.json")]
        for path in [*(folder / "hall_of_fame").iterdir(), *trees]:
            assert path.read_bytes() == (tmp_path / "two" / path.relative_to(folder)).read_bytes()
        assert summary.explored > 0
        assert re.search(rf"exploring +{summary.explored} trees refined from the hall of fame", output)

    def test_history_tells_how_many_trees_were_explored(self, one):
        folder, summary, _ = one
        explored = [record.explored for record in RunFolder(folder).read_history()]
        assert explored[:2] == [0, 0]
        assert explored == sorted(explored)
        assert explored[-1] == summary.explored

    def test_what_is_asked_for_is_done_and_nothing_else(self, tmp_path):
        nothing, _ = explored(tmp_path / "0", neighbours=0, revisits=0, final_keep=0, migrants=0)
        assert nothing.explored == 0
        revisits, _ = explored(tmp_path / "1", neighbours=0, final_keep=0, migrants=0)
        assert 0 < revisits.explored <= 2
        final, _ = explored(tmp_path / "2", neighbours=0, revisits=0, migrants=0)
        assert (final.explored, final.env_steps > nothing.env_steps) == (0, True)
        same = [RunFolder(tmp_path / name).read_history() for name in "02"]
        assert [r.best_fitness for r in same[0]] == [r.best_fitness for r in same[1]]
        migrants, _ = explored(tmp_path / "3", neighbours=0, revisits=0, final_keep=0)
        assert migrants.explored == 0
        means = [
            [record.mean_fitness for record in RunFolder(tmp_path / name).read_history()] for name in "03"
        ]
        assert means[0][:2] == means[1][:2]
        assert means[1][2] > means[0][2]

    def test_thresholds_are_constants_of_the_grammar(self, one):
        folder, _, _ = one
        found = [record for record in RunFolder(folder).read_hall_of_fame() if record.origin == "neighbour"]
        assert found
        for record in found:
            tree = RunFolder(folder).read_hall_of_fame_tree(record.decision_nodes).tree
            steps = tree.threshold.astype(float) * 100
            assert abs(steps - steps.round()).max() < 1e-4


def test_the_default_program_loads_no_torch(tmp_path):
    code = (
        "import sys; from ge_torchrl.__main__ import main; "
        f"status = main(['ge.generations=2', 'ge.population_size=20', 'hydra.run.dir={tmp_path}/run', "
        "'hall_of_fame.neighbours=2', 'hall_of_fame.final_keep=0', 'hall_of_fame.episodes=20', "
        "'refiner.cmaes.max_timesteps=20000', 'evaluation.validation_episodes=20']); "
        "sys.exit(status or 'torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, timeout=120, capture_output=True)
    assert done.returncode == 0
