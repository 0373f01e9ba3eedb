"""A whole run, on a small scale, and everything that it leaves."""

import json
import re
from dataclasses import asdict, replace

import pytest
import yaml
from runs_for_tests import assert_same_bytes, config, run, without_clock
from walks_for_tests import BNF, CountingWalkEnv, registered

from ge_torchrl.artefacts.folder import RunFolder, find_runs
from ge_torchrl.artefacts.records import CLOCK_FIELDS
from ge_torchrl.config import Config
from ge_torchrl.environments.choose import open_backend
from ge_torchrl.environments.spec import describe
from ge_torchrl.errors import ArtefactError, EnvironmentFaultError, GrammarError
from ge_torchrl.run import experiment
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.forest import Forest

FILES = {
    "archive",
    "archive.jsonl",
    "best_tree.json",
    "best_tree.txt",
    "best_tree_full.json",
    "config.yaml",
    "episodes.json",
    "history.jsonl",
    "report.html",
    "summary.json",
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "run"
    summary, output = run(config(), folder)
    return folder, summary, output


class TestFolder:
    def test_it_holds_what_it_promises(self, finished):
        folder, summary, _ = finished
        assert {path.name for path in folder.iterdir()} == FILES
        assert RunFolder(folder).read_summary() == summary
        written = json.loads((folder / "summary.json").read_text())
        assert written.pop("crc32")
        # Its page can be made anew.
        others = {path.relative_to(folder).as_posix() for path in folder.rglob("*.*") if path.is_file()}
        assert written.pop("sha256").keys() == others - {"summary.json", "report.html"}
        assert written == {**asdict(summary), "warnings": []}
        history = RunFolder(folder).read_history()
        assert [record.generation for record in history] == list(range(15))
        assert summary.generations == 15
        assert history[-1].env_steps == summary.env_steps < summary.env_steps_total
        assert summary.invalid_fraction == sum(r.invalid for r in history) / sum(r.born for r in history)
        assert [found.path for found in find_runs(folder.parent)] == [folder]

    def test_its_configuration_is_what_the_run_used_and_gives_it_again(self, finished, tmp_path):
        folder, _, _ = finished
        used = Config.from_mapping(yaml.safe_load((folder / "config.yaml").read_text()))
        assert used == config().resolved(1e8)
        run(used, tmp_path / "again")
        assert_same_bytes(folder, tmp_path / "again")

    def test_the_summary_is_the_truth_about_the_tree(self, finished):
        folder, summary, _ = finished
        controller = RunFolder(folder).read_best_tree()
        backend = open_backend(describe("CartPole-v1"))
        seeds = episode_seeds("test", 20, stream(0, "test episodes"))
        returns = backend.evaluate(Forest.stack([controller.tree]), seeds, "test").returns[0]
        backend.close()
        assert (summary.test_mean, summary.test_std) == (returns.mean(), returns.std())
        assert summary.solved == (returns.mean() >= 475)
        assert summary.decision_nodes == controller.tree.num_decision_nodes
        assert summary.complexity_M == pytest.approx(17.8 * summary.decision_nodes)
        assert controller.provenance["test_mean"] == summary.test_mean

    def test_the_output_shows_the_tree_the_verdict_and_the_folder(self, finished):
        folder, summary, output = finished
        assert re.search(r"gen +best +median +splits +steps/s +left", output)
        assert f"{summary.test_mean:.2f} ± {summary.test_std:.2f}  on 20 unseen episodes" in output
        assert ("SOLVED" if summary.solved else "not solved") in output
        assert f"M = {summary.complexity_M:g}" in output
        assert str(folder) in output
        tree = (folder / "best_tree.txt").read_text().split("\n\n")[0]
        assert tree in output
        assert re.search(r"theta(_dot)? < -?[\d.]+ rad", tree)

    def test_a_finished_run_is_never_overwritten(self, finished):
        with pytest.raises(ArtefactError, match=r"holds summary\.json already"):
            run(config(), finished[0])

    def test_nothing_is_written_where_the_plan_is_refused(self, tmp_path):
        with pytest.raises(EnvironmentFaultError, match="NoSuchThing"):
            run(config(env={"id": "NoSuchThing-v0"}), tmp_path / "run")
        with pytest.raises(GrammarError, match="line 2"):
            run(config(grammar={"bnf": "\n<if> := nothing"}), tmp_path / "run")
        assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("mode", ["fixed", "fresh", "common"])
def test_same_seed_gives_the_same_bytes_on_one_thread_and_on_two(tmp_path, mode):
    """Law 6."""
    for threads in (1, 2):
        run(config(seed=5, evaluation={"threads": threads, "episode_seeds": mode}), tmp_path / str(threads))
    assert_same_bytes(tmp_path / "1", tmp_path / "2")


def test_another_seed_gives_another_run(finished, tmp_path):
    run(config(seed=1), tmp_path / "other")
    assert without_clock(tmp_path / "other" / "history.jsonl") != without_clock(finished[0] / "history.jsonl")


def test_both_routes_evolve_the_same_tree(tmp_path):
    small = {"population_size": 10, "generations": 3, "genotype_length": 40, "gene_probability": 0.1}
    few = {"episodes": 2, "validation_episodes": 3, "test_episodes": 3}
    found = {}
    for route in ("kernel", "gymnasium"):
        settings = config(
            env={"route": route, "workers": 1}, ge=small, evaluation=few, archive={"episodes": 3}
        )
        summary, _ = run(settings, tmp_path / route)
        assert summary.route == route
        found[route] = RunFolder(tmp_path / route).read_best_tree().tree, summary.steps, summary.test_mean
    assert found["kernel"] == found["gymnasium"]


def test_settings_that_are_left_open_follow_the_measured_speed(tmp_path):
    settings = config(evaluation={"steps_per_second": None}, polish={"every": None}, ge={"generations": 1})
    summary, _ = run(settings, tmp_path / "run")
    used = RunFolder(tmp_path / "run").read_config()
    assert used.polish.every == 1
    assert used.evaluation.steps_per_second == summary.steps_per_second > 1e6


class TestLedger:
    def test_the_steps_are_those_that_a_counting_wrapper_saw(self, tmp_path, opened):
        summary, _ = run(config(), tmp_path / "run")
        (backend,) = opened
        assert summary.steps == backend.counted
        assert summary.env_steps_total == backend.counted.total()
        assert summary.env_steps == backend.counted["training"] + backend.counted["archive"]
        assert set(summary.steps) == {"training", "archive", "validation", "test", "record"}

    def test_the_steps_are_those_that_were_made_in_the_environment(self, tmp_path, monkeypatch):
        def open_and_forget(*args):
            backend = open_backend(*args)
            # The first look at an environment is not counted.
            CountingWalkEnv.made.clear()
            return backend

        monkeypatch.setattr(experiment, "open_backend", open_and_forget)
        with registered(CountingWalkEnv) as env:
            settings = config(
                env=env,
                grammar={"bnf": BNF},
                ge={"generations": 4, "population_size": 10},
                evaluation={"episodes": 2, "validation_episodes": 5, "test_episodes": 5},
                refiner={"method": "cmaes", "schedule": {"every": 2}, "acceptance_episodes": 3, "min_nodes": 1},
                polish={"max_timesteps": 2000, "every": 1, "episodes": 3},
                archive={
                    "keep": 3, "episodes": 5, "neighbours": 2, "neighbours_drawn": 5,
                    "revisit_factor": 2, "migrants": 2, "final_keep": 1, "final_factor": 2,
                },
            )  # fmt: skip
            summary, _ = run(settings, tmp_path / "run")
        assert summary.refined > 0 < summary.polished
        assert summary.env_steps_total == CountingWalkEnv.made["steps"]
        assert RunFolder(tmp_path / "run").read_history()[-1].env_steps < summary.env_steps


class TestStopWhenSolved:
    def test_it_asks_the_validation_episodes(self, tmp_path):
        easy = config(env={"solved_at": 30}, ge={"stop_when_solved": True, "generations": 100})
        summary, _ = run(easy, tmp_path / "run")
        assert summary.stopped_by == "solved"
        assert summary.generations < 100
        assert summary.validation_mean >= 30
        assert summary.steps["asking validation"] >= 30 * 30
        never, output = run(config(ge={"generations": summary.generations}), tmp_path / "never")
        assert "asking validation" not in never.steps
        assert summary.steps["training"] == never.steps["training"]
        assert "stopped by" not in output


def test_penalty_and_parsimony_reach_evolution(finished, tmp_path):
    run(config(evaluation={"std_penalty": 1.0}), tmp_path / "steady")
    run(config(ge={"parsimony": "none"}), tmp_path / "plain")
    small, steady, plain = (
        RunFolder(path).read_history() for path in (finished[0], tmp_path / "steady", tmp_path / "plain")
    )
    assert steady[0].median_fitness < plain[0].median_fitness, "the same trees on the same episodes"
    clock = {name: getattr(small[0], name) for name in CLOCK_FIELDS & vars(small[0]).keys()}
    assert small[0] == replace(plain[0], **clock)
    assert small[-1] != plain[-1]
