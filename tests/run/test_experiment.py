"""A whole run, on a small scale, and everything that it leaves."""

import io
import json
import re
from dataclasses import asdict, replace

import gymnasium as gym
import pytest
import yaml
from environments_for_tests import CountdownEnv
from faulty_environments import LateNaNEnv, RaisingEnv
from rich.console import Console
from runs_for_tests import assert_same_bytes, config, run, without_clock
from walks_for_tests import BNF, CountingWalkEnv, registered

from ge_torchrl.artefacts.folder import RunFolder, find_runs
from ge_torchrl.artefacts.records import CLOCK_FIELDS
from ge_torchrl.config import Config
from ge_torchrl.environments.choose import open_backend
from ge_torchrl.environments.spec import describe
from ge_torchrl.errors import ArtefactError, EnvironmentFaultError, GrammarError, RunFaultError
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
    "history.jsonl",
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
        assert json.loads((folder / "summary.json").read_text()) == {**asdict(summary), "warnings": []}
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
        with pytest.raises(ArtefactError, match="holds one already"):
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
        assert set(summary.steps) == {"training", "archive", "validation", "test"}

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


class TestInterrupt:
    @staticmethod
    def interrupt_in(monkeypatch, generation):
        original = experiment.Progress.show

        def interrupted(self, record):
            original(self, record)
            if record.generation == generation:
                raise KeyboardInterrupt

        monkeypatch.setattr(experiment.Progress, "show", interrupted)

    def test_it_keeps_and_tests_what_was_found(self, tmp_path, monkeypatch):
        self.interrupt_in(monkeypatch, 4)
        summary, output = run(config(), tmp_path / "run")
        assert (summary.stopped_by, summary.generations) == ("interrupt", 5)
        assert len(RunFolder(tmp_path / "run").read_history()) == 5
        assert re.search(r"stopped by +interrupt", output)
        assert "Ctrl-C again leaves it untested" in output

    def test_a_second_one_leaves_the_best_tree_and_the_archive_untested(self, tmp_path, monkeypatch):
        def impatient(*_):
            raise KeyboardInterrupt

        monkeypatch.setattr(experiment, "choose", impatient)
        with pytest.raises(KeyboardInterrupt):
            run(config(), tmp_path / "run")
        assert_untested(RunFolder(tmp_path / "run"))

    def test_where_nobody_reads_any_more_what_was_found_is_kept_and_nothing_is_called_broken(self, tmp_path):
        class Closed(io.StringIO):
            def write(self, text):
                if text.startswith("    3 "):
                    raise BrokenPipeError
                return super().write(text)

        class ClosedConsole(Console):
            def on_broken_pipe(self):
                self.quiet = True
                raise BrokenPipeError

        with pytest.raises(BrokenPipeError):
            experiment.run(config(), tmp_path / "run", ClosedConsole(file=Closed(), width=100))
        assert_untested(RunFolder(tmp_path / "run"))
        assert not (tmp_path / "run" / "traceback.txt").exists()

    def test_in_the_last_refinement_it_goes_on_with_what_was_there(self, tmp_path, monkeypatch):
        def impatient(*_):
            raise KeyboardInterrupt

        monkeypatch.setattr(experiment, "refine_once_more", impatient)
        settings = config(
            ge={"generations": 2}, polish={"every": 1, "max_timesteps": 5000}, archive={"final_keep": 1}
        )
        summary, output = run(settings, tmp_path / "run")
        assert (summary.stopped_by, summary.generations) == ("generations", 2)
        assert "Ctrl-C again leaves it untested" in output

    def test_before_the_first_generation_there_is_nothing_to_keep(self, tmp_path, monkeypatch):
        def impatient(*_):
            raise KeyboardInterrupt

        monkeypatch.setattr(experiment.Search, "run", impatient)
        with pytest.raises(KeyboardInterrupt):
            run(config(), tmp_path / "run")
        assert {path.name for path in (tmp_path / "run").iterdir()} == {"config.yaml", "history.jsonl"}


def assert_untested(folder):
    """Assert that the best tree and the archive are there, and that nothing is said of a test."""
    history = folder.read_history()
    controller = folder.read_best_tree()
    assert controller.provenance["test_mean"] is None
    assert controller.provenance["train_fitness"] >= history[-1].best_fitness
    records = folder.read_archive()
    assert records
    for record in records:
        assert (record.validation_mean, record.test_mean) == (None, None)
        assert (
            folder.read_archive_tree(record.decision_nodes).tree.num_decision_nodes == record.decision_nodes
        )
    assert not (folder.path / "summary.json").exists()


class TestFault:
    @staticmethod
    def break_in(monkeypatch, generation, fault):
        original = experiment.Progress.show

        def breaking(self, record):
            original(self, record)
            if record.generation == generation:
                raise fault

        monkeypatch.setattr(experiment.Progress, "show", breaking)

    def test_a_fault_of_the_environment_keeps_the_best_tree_and_the_archive(self, tmp_path, monkeypatch):
        self.break_in(monkeypatch, 3, EnvironmentFaultError("CartPole-v1 raised OSError(),\nand what not"))
        with pytest.raises(EnvironmentFaultError) as raised:
            run(config(), tmp_path / "run")
        text = str(raised.value)
        assert re.fullmatch(
            r"CartPole-v1 raised OSError\(\), and what not; the best tree so far is in .*run, untested", text
        )
        assert len(RunFolder(tmp_path / "run").read_history()) == 4
        assert_untested(RunFolder(tmp_path / "run"))

    @pytest.mark.parametrize("fault", [ZeroDivisionError("a bug\nof ours"), MemoryError()])
    def test_a_bug_does_too_and_says_where_its_details_are(self, tmp_path, monkeypatch, fault):
        self.break_in(monkeypatch, 3, fault)
        with pytest.raises(RunFaultError) as raised:
            run(config(), tmp_path / "run")
        text = str(raised.value)
        assert "\n" not in text
        assert re.search(
            rf"broke off \({type(fault).__name__}: ?.*\); the best tree .* untested; details are in .*", text
        )
        trace = tmp_path / "run" / "traceback.txt"
        assert str(trace) in text
        assert "in breaking" in trace.read_text()
        assert_untested(RunFolder(tmp_path / "run"))

    @pytest.mark.parametrize("phase", ["choose", "examine", "refine_once_more"])
    def test_whatever_the_phase(self, tmp_path, monkeypatch, phase):
        def broken(*_):
            raise RuntimeError(phase)

        monkeypatch.setattr(experiment, phase, broken)
        settings = config(
            ge={"generations": 3}, polish={"every": 1, "max_timesteps": 2000}, archive={"final_keep": 1}
        )
        with pytest.raises(RunFaultError, match=rf"RuntimeError: {phase}.*untested"):
            run(settings, tmp_path / "run")
        assert_untested(RunFolder(tmp_path / "run"))

    def test_before_the_first_tree_that_is_said(self, tmp_path, monkeypatch):
        def broken(*_):
            raise RuntimeError("early")

        monkeypatch.setattr(experiment.Search, "run", broken)
        with pytest.raises(RunFaultError, match="no tree was there yet"):
            run(config(), tmp_path / "run")

    def test_genotypes_too_short_for_the_grammar_are_explained(self, tmp_path):
        with pytest.raises(
            GrammarError, match=r"no genotype of 2 codons gave a tree.*ge\.genotype_length"
        ) as raised:
            run(config(ge={"genotype_length": 2}), tmp_path / "run")
        assert "\n" not in str(raised.value)


def own(env, **sections):
    """Return the configuration of an environment of ours, for a short run."""
    small = {"generations": 3, "population_size": 6}
    few = {"episodes": 2, "validation_episodes": 5, "test_episodes": 5}
    return config(
        env=env, grammar={"bnf": BNF}, ge={**small, **sections.pop("ge", {})}, evaluation=few,
        archive={"episodes": 3}, **sections,
    )  # fmt: skip


class TestOwnEnvironments:
    def test_any_environment_runs_and_one_without_threshold_has_no_verdict(self, tmp_path):
        with registered(CountdownEnv) as env:
            summary, output = run(own({**env, "route": "auto"}, ge={"generations": 8}), tmp_path / "run")
        assert (summary.solved, summary.route) == (None, "gymnasium")
        assert summary.test_mean == 18.0, "the second action pays 6 for each of three steps"
        assert "no threshold" in output
        # All branches that are visited pay best with the same action: pruning leaves one leaf.
        assert "always a1" in output

    def test_a_fault_in_its_first_steps_names_it_and_leaves_no_folder(self, tmp_path):
        with (
            registered(RaisingEnv) as env,
            pytest.raises(EnvironmentFaultError, match=r"the motor.*is on fire"),
        ):
            run(own(env), tmp_path / "run")
        assert not (tmp_path / "run").exists()

    def test_a_fault_in_mid_run_names_it_and_keeps_the_best_tree(self, tmp_path):
        class Late(LateNaNEnv):
            """Observes NaN in the first test episode."""

            def reset(self, *, seed=None, options=None):
                first = int(episode_seeds("test", 5, stream(0, "test episodes"))[0])
                return super().reset(seed=9999 if seed == first else seed, options=options)

        with (
            registered(Late) as env,
            pytest.raises(EnvironmentFaultError, match=r"NaN.*the best tree.*untested"),
        ):
            run(own(env), tmp_path / "run")
        assert_untested(RunFolder(tmp_path / "run"))
        assert gym.registry.get("Walk-v0") is None


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
