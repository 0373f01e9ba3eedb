"""Whole runs with refinement, polish and archive: what a setting switches on is done, and nothing else."""

import re
import subprocess
import sys

import pytest
from runs_for_tests import assert_same_bytes, config, run, without_clock

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.environments.choose import open_backend
from ge_torchrl.environments.spec import describe
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.forest import Forest

SMALL = {"generations": 8, "population_size": 30}
NO_ARCHIVE = {"keep": 0}
LITTLE_PPO = {"max_timesteps": 400, "update_timesteps": 200, "epochs": 2, "snapshot_episodes": 5}
# Accepts and writes back nothing, as the thesis does.
APART = {"schedule": {"every": 3}, "acceptance_episodes": 0, "measuring_episodes": 5, "write_back": False}
LITTLE_POLISH = {"every": 0, "max_timesteps": 3000, "episodes": 5, "moves": 4}


def history(folder):
    return RunFolder(folder).read_history()


def refining(folder, method="ppo", threads=1, **refiner):
    settings = config(
        ge=SMALL,
        evaluation={"threads": threads},
        refiner={**APART, "method": method, "ppo": LITTLE_PPO, **refiner},
        polish=LITTLE_POLISH,
        archive=NO_ARCHIVE,
    )
    return run(settings, folder)


@pytest.mark.parametrize("method", ["ppo", "cmaes"])
class TestRefiner:
    def test_refinements_are_recorded_and_shown_and_evolution_is_the_same_without(self, tmp_path, method):
        summary, output = refining(tmp_path / "with", method)
        records = RunFolder(tmp_path / "with").read_refinements()
        assert [record.generation for record in records] == [3, 6]
        assert {record.origin for record in records} == {"individual"}
        assert summary.refinements == summary.refined == 2
        assert summary.refinements_improved == sum(record.outcome == "improved" for record in records)
        assert summary.refine_seconds > 0
        name = {"ppo": "PPO", "cmaes": "CMA-ES"}[method]
        assert output.count(f"{name}:") == 2
        assert re.search(rf"{name} +2 trees refined in .*, \d of them improved", output)
        assert all((record.actor_loss is None) == (method == "cmaes") for record in records)
        timesteps = sum(record.timesteps for record in records)
        # PPO's snapshots are measured too.
        assert 0 < timesteps <= summary.steps["refinement"]
        assert (timesteps == summary.steps["refinement"]) >= (method == "cmaes")
        run(config(ge=SMALL, archive=NO_ARCHIVE), tmp_path / "without")
        with_it, without = history(tmp_path / "with"), history(tmp_path / "without")
        assert [one.best_fitness for one in with_it] == [one.best_fitness for one in without]
        assert not (tmp_path / "without" / "refinements.jsonl").exists()

    def test_runs_are_byte_identical_on_two_threads(self, tmp_path, method):
        """Law 6."""
        beyond = {"write_back": True, "candidates": 2, "acceptance_episodes": 5}
        for threads in (1, 2):
            refining(tmp_path / str(threads), method, threads, **beyond)
        assert len(RunFolder(tmp_path / "1").read_refinements()) == 4
        assert_same_bytes(tmp_path / "1", tmp_path / "2")


def test_ppos_steps_are_those_that_a_counting_wrapper_saw(tmp_path, opened):
    summary, _ = refining(tmp_path / "run")
    (backend,) = opened
    assert summary.steps == backend.counted
    assert backend.counted["refinement"] >= 2 * LITTLE_PPO["max_timesteps"]


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    folder = tmp_path_factory.mktemp("archive") / "run"
    return folder, *run(config(archive={"episodes": 20, "max_nodes": 6}), folder)


class TestArchive:
    def test_table_and_trees_tell_the_truth(self, kept):
        folder = RunFolder(kept[0])
        records = folder.read_archive()
        sizes = [record.decision_nodes for record in records]
        assert sizes == sorted(set(sizes))
        assert {path.name for path in (folder.path / "archive").iterdir()} == {f"{n:02}.json" for n in sizes}
        trees = [folder.read_archive_tree(size).tree for size in sizes]
        backend = open_backend(describe("CartPole-v1"))
        seeds = episode_seeds("test", 20, stream(0, "test episodes"))
        outcomes = backend.evaluate(Forest.stack(trees), seeds, "test")
        backend.close()
        for record, tree, returns in zip(records, trees, outcomes.returns, strict=True):
            assert (record.decision_nodes, record.depth) == (tree.num_decision_nodes, tree.depth)
            assert (record.test_mean, record.test_std) == (returns.mean(), returns.std())

    def test_the_champion_is_the_best_of_its_size_and_nobody_was_better_in_validation(self, kept):
        path, summary, output = kept
        folder = RunFolder(path)
        records = folder.read_archive()
        (mine,) = [record for record in records if record.decision_nodes == summary.decision_nodes]
        assert (mine.test_mean, mine.validation_mean) == (summary.test_mean, summary.validation_mean)
        assert summary.validation_mean == max(record.validation_mean for record in records)
        assert folder.read_archive_tree(mine.decision_nodes).tree == folder.read_best_tree().tree
        row = rf"^ +{mine.decision_nodes}  .*{mine.test_mean:.2f} ± .*champion$"
        assert re.search(row, output, re.MULTILINE)

    def test_evolution_is_the_same_without_and_the_champion_no_better(self, kept, tmp_path):
        without, _ = run(config(archive={"keep": 0}), tmp_path / "without")
        ours, theirs = (
            [{**line, "env_steps": 0} for line in without_clock(folder / "history.jsonl")]
            for folder in (kept[0], tmp_path / "without")
        )
        assert ours == theirs
        assert kept[1].env_steps_total > without.env_steps_total
        assert kept[1].validation_mean >= without.validation_mean
        assert not (tmp_path / "without" / "archive").exists()


EXPLORED = {
    "episodes": 20,
    "max_nodes": 4,
    "neighbours": 4,
    "neighbours_drawn": 40,
    "revisit_factor": 2,
    "final_keep": 2,
    "final_factor": 2,
    "migrants": 5,
}


def explored(folder, threads=1, polish=None, **archive):
    settings = config(
        ge={"generations": 6, "population_size": 30},
        evaluation={"threads": threads},
        refiner={**APART, "method": "cmaes", "schedule": {"every": 2}, "write_back": True},
        polish={**LITTLE_POLISH, "every": 2, "settling_episodes": 10, **(polish or {})},
        archive={**EXPLORED, **archive},
    )
    return run(settings, folder)


@pytest.fixture(scope="module")
def one(tmp_path_factory):
    folder = tmp_path_factory.mktemp("explored") / "one"
    return folder, *explored(folder)


class TestExploring:
    def test_runs_are_byte_identical_on_two_threads(self, one, tmp_path):
        """Law 6."""
        explored(tmp_path / "two", threads=2)
        assert_same_bytes(one[0], tmp_path / "two")

    def test_records_history_summary_and_screen_agree(self, one):
        folder, summary, output = one
        refined = [record.refined for record in history(folder)]
        polished = [record.polished for record in history(folder)]
        records = RunFolder(folder).read_refinements()
        assert refined[:2] == polished[:2] == [0, 0]
        assert (refined, polished) == (sorted(refined), sorted(polished))
        assert refined[-1] == summary.refined == len(records)
        assert polished[-1] == summary.polished
        assert {record.origin for record in records} == {"individual", "neighbour", "archive"}
        assert re.search(rf"polish +{summary.polished} trees polished in ", output)

    def test_what_is_asked_for_is_done_and_nothing_else(self, tmp_path):
        nothing, _ = explored(tmp_path / "0", neighbours=0, revisit_factor=0, final_keep=0, migrants=0)
        assert nothing.refined == nothing.polished == 2
        assert "final refinement" not in nothing.steps
        revisits, _ = explored(tmp_path / "1", neighbours=0, final_keep=0, migrants=0)
        assert revisits.refined == 4
        final, _ = explored(tmp_path / "2", neighbours=0, revisit_factor=0, migrants=0)
        assert final.refined == 2
        assert final.steps["final refinement"] > 0
        same = [history(tmp_path / name) for name in "02"]
        assert [one.best_fitness for one in same[0]] == [one.best_fitness for one in same[1]]
        explored(tmp_path / "3", neighbours=0, revisit_factor=0, final_keep=0)
        means = [[record.mean_fitness for record in history(tmp_path / name)] for name in "03"]
        assert means[0][:2] == means[1][:2]
        assert means[1][2] > means[0][2]
        unpolished, output = explored(tmp_path / "4", polish={"every": 0})
        assert (unpolished.polished, "polish" in unpolished.steps) == (0, False)
        assert "polished" not in output

    def test_numbers_are_constants_of_the_grammar(self, one):
        folder = RunFolder(one[0])
        found = [record for record in folder.read_archive() if record.origin != "population"]
        assert found
        for record in found:
            steps = folder.read_archive_tree(record.decision_nodes).tree.threshold.astype(float) * 100
            assert abs(steps - steps.round()).max() < 1e-4


def test_torch_is_loaded_for_the_first_tree_that_ppo_refines(tmp_path):
    """Nobody pays for what was not asked for."""
    code = f"""
from runs_for_tests import config, run
from pathlib import Path
refiner = {{"measuring_episodes": 5, "acceptance_episodes": 5}}
for method, every in (("cmaes", 1), ("ppo", 3)):
    settings = config(
        ge={{"generations": 3, "population_size": 10}},
        refiner={{**refiner, "method": method, "schedule": {{"every": every}}}},
        polish={{"every": 1, "max_timesteps": 2000}},
    )
    run(settings, Path({str(tmp_path)!r}) / method)
sys.exit("torch" in sys.modules)
"""
    path = next(entry for entry in sys.path if entry.endswith("support"))
    command = [sys.executable, "-c", f"import sys; sys.path.append({path!r})\n{code}"]
    done = subprocess.run(command, check=False, timeout=120, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
