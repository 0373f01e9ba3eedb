"""A whole run, on a small scale, and everything that it leaves."""

import json
import re
from dataclasses import asdict, replace

import gymnasium as gym
import pytest
import yaml
from environments_for_tests import CountdownEnv, RaisingEnv
from runs_for_tests import config, run, without_clock

from ge_torchrl import conclusion, experiment
from ge_torchrl.artefacts import RunFolder, find_runs
from ge_torchrl.config import Config
from ge_torchrl.environments.choose import open_route
from ge_torchrl.environments.spec import describe
from ge_torchrl.errors import ArtefactError, EnvironmentFaultError, GrammarError
from ge_torchrl.records import CLOCK_FIELDS
from ge_torchrl.seeding import episode_seeds, stream
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.serialization import read_tree

FILES = {
    "config.yaml",
    "history.jsonl",
    "best_tree.json",
    "best_tree_full.json",
    "best_tree.txt",
    "summary.json",
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "run"
    summary, output = run(config(), folder)
    return folder, summary, output


def test_run_folder_holds_what_it_promises(finished):
    folder, summary, _ = finished
    assert {path.name for path in folder.iterdir()} == FILES
    assert json.loads((folder / "summary.json").read_text()) == asdict(summary)
    assert Config.from_mapping(yaml.safe_load((folder / "config.yaml").read_text())) == config()
    history = RunFolder(folder).read_history()
    assert [record.generation for record in history] == list(range(15))
    assert summary.generations == 15
    assert history[-1].env_steps == summary.env_steps < summary.env_steps_total
    assert summary.invalid_fraction == sum(r.invalid for r in history) / sum(r.born for r in history)
    assert [found.path for found in find_runs(folder.parent)] == [folder]


def test_summary_is_the_truth_about_the_tree_in_the_folder(finished):
    folder, summary, _ = finished
    document = read_tree(folder / "best_tree.json")
    route = open_route(describe("CartPole-v1"))
    seeds = episode_seeds("test", 20, stream(0, "test episodes"))
    returns = route.evaluate(Forest.stack([document.tree]), seeds).returns[0]
    route.close()
    assert (summary.test_mean, summary.test_std) == (returns.mean(), returns.std())
    assert summary.solved == (returns.mean() >= 475)
    assert summary.decision_nodes == document.tree.n_decision_nodes
    assert summary.complexity_M == pytest.approx(17.8 * summary.decision_nodes)
    assert document.provenance["test_mean"] == summary.test_mean


def test_output_shows_the_tree_the_verdict_and_the_folder(finished):
    folder, summary, output = finished
    assert re.search(r"generation +best +median +splits of best +env steps/s +time left", output)
    assert f"{summary.test_mean:.2f} ± {summary.test_std:.2f}  on 20 unseen episodes" in output
    assert ("SOLVED" if summary.solved else "not solved") in output
    assert f"M = {summary.complexity_M:g}" in output
    assert str(folder) in output
    tree = (folder / "best_tree.txt").read_text().split("\n\n")[0]
    assert tree in output
    assert re.search(r"theta(_dot)? < -?[\d.]+ rad", tree)


@pytest.mark.parametrize("mode", ["fixed", "fresh", "common"])
def test_same_seed_gives_the_same_bytes_on_one_thread_and_on_two(tmp_path, mode):
    """Law 6."""
    for threads in (1, 2):
        run(config(seed=5, evaluation={"threads": threads, "episode_seeds": mode}), tmp_path / str(threads))
    one, two = tmp_path / "1", tmp_path / "2"
    for name in ("best_tree.json", "best_tree_full.json", "best_tree.txt"):
        assert (one / name).read_bytes() == (two / name).read_bytes()
    assert without_clock(one / "history.jsonl") == without_clock(two / "history.jsonl")
    ours, theirs = RunFolder(one).read_summary(), RunFolder(two).read_summary()
    still = {"evolve_seconds": 0, "wall_seconds": 0}
    assert replace(ours, **still) == replace(theirs, **still)


def test_another_seed_gives_another_run(finished, tmp_path):
    run(config(seed=1), tmp_path / "other")
    assert without_clock(tmp_path / "other" / "history.jsonl") != without_clock(finished[0] / "history.jsonl")


def test_both_routes_evolve_the_same_tree(tmp_path):
    small = {"population_size": 10, "generations": 3, "genotype_length": 40, "gene_probability": 0.1}
    few = {"episodes": 2, "validation_episodes": 3, "test_episodes": 3}
    for route in ("compiled", "gymnasium"):
        chosen = config(env={"route": route, "workers": 1}, ge=small, evaluation=few)
        assert run(chosen, tmp_path / route)[0].route == route
    trees = [read_tree(tmp_path / route / "best_tree.json").tree for route in ("compiled", "gymnasium")]
    assert trees[0] == trees[1]


def test_penalty_and_parsimony_reach_evolution(finished, tmp_path):
    run(config(evaluation={"std_penalty": 1.0}), tmp_path / "steady")
    run(config(ge={"parsimony": "lexicographic", "parsimony_tolerance": 500.0}), tmp_path / "small")
    plain, steady, small = (
        RunFolder(path).read_history() for path in (finished[0], tmp_path / "steady", tmp_path / "small")
    )
    assert steady[0].median_fitness < plain[0].median_fitness, "the same trees on the same episodes"
    assert small[0] == replace(
        plain[0], **{name: getattr(small[0], name) for name in CLOCK_FIELDS & vars(small[0]).keys()}
    )
    assert small[-1].mean_fitness < plain[-1].mean_fitness, "with this tolerance nothing but size is selected"


@pytest.mark.parametrize(
    ("changes", "reason"),
    [({"max_env_steps": 1}, "max_env_steps"), ({"max_seconds": 1e-6}, "max_seconds")],
)
def test_a_budget_ends_the_run_early_with_all_artefacts(tmp_path, changes, reason):
    summary, output = run(config(ge=changes), tmp_path / "run")
    assert (summary.stopped_by, summary.generations) == (reason, 1)
    assert {path.name for path in (tmp_path / "run").iterdir()} == FILES
    assert reason in output


def test_stop_when_solved_asks_the_validation_episodes(tmp_path):
    easy = config(env={"solved_at": 30}, ge={"stop_when_solved": True, "generations": 100})
    summary, _ = run(easy, tmp_path / "run")
    assert summary.stopped_by == "solved"
    assert summary.generations < 100
    assert summary.validation_mean >= 30
    # The champion is validated and tested anyway; that it was asked before comes on top.
    at_least = easy.evaluation.validation_episodes * 30
    never, _ = run(config(ge={"generations": summary.generations}), tmp_path / "never")
    assert summary.env_steps == never.env_steps
    assert summary.env_steps_total >= never.env_steps_total + at_least


def test_ctrl_c_keeps_what_was_found(tmp_path, monkeypatch):
    original = experiment.Progress.show

    def interrupted(self, record):
        original(self, record)
        if record.generation == 4:
            raise KeyboardInterrupt

    monkeypatch.setattr(experiment.Progress, "show", interrupted)
    summary, output = run(config(), tmp_path / "run")
    assert (summary.stopped_by, summary.generations) == ("interrupt", 5)
    assert len(RunFolder(tmp_path / "run").read_history()) == 5
    assert "interrupt" in output


def test_a_second_ctrl_c_leaves_the_best_tree_untested(tmp_path, monkeypatch):
    def impatient(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(conclusion, "choose_champion", impatient)
    with pytest.raises(KeyboardInterrupt):
        run(config(), tmp_path / "run")
    document = read_tree(tmp_path / "run" / "best_tree.json")
    assert document.provenance["test_mean"] is None
    assert document.provenance["train_fitness"] == RunFolder(tmp_path / "run").read_history()[-1].best_fitness
    assert not (tmp_path / "run" / "summary.json").exists()


def test_a_fault_in_mid_run_keeps_the_best_tree_so_far(tmp_path, monkeypatch):
    original = experiment.TrainingEpisodes.next_generation
    calls = []

    def breaking(self):
        calls.append(self)
        if len(calls) == 4:
            raise EnvironmentFaultError("CartPole-v1 raised OSError()")
        return original(self)

    monkeypatch.setattr(experiment.TrainingEpisodes, "next_generation", breaking)
    with pytest.raises(
        EnvironmentFaultError, match=r"raised OSError.*the best tree so far is in .*run, untested"
    ):
        run(config(), tmp_path / "run")
    history = RunFolder(tmp_path / "run").read_history()
    assert len(history) == 3
    assert (
        read_tree(tmp_path / "run" / "best_tree.json").provenance["train_fitness"] == history[-1].best_fitness
    )


def test_a_finished_run_is_never_overwritten(finished):
    with pytest.raises(ArtefactError, match="holds one already"):
        run(config(), finished[0])


def test_genotypes_too_short_for_the_grammar_are_explained(tmp_path):
    with pytest.raises(GrammarError, match=r"no genotype of 2 codons gave a tree.*ge\.genotype_length"):
        run(config(ge={"genotype_length": 2}), tmp_path / "run")


def test_plan_refuses_before_anything_is_written(tmp_path):
    with pytest.raises(EnvironmentFaultError, match="NoSuchThing"):
        run(config(env={"id": "NoSuchThing-v0"}), tmp_path / "run")
    with pytest.raises(GrammarError, match="line 2"):
        run(config(grammar={"bnf": "\n<if> := nothing"}), tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.fixture
def countdown():
    gym.register("Countdown-v0", entry_point=CountdownEnv)
    gym.register("Raising-v0", entry_point=RaisingEnv)
    yield
    del gym.registry["Countdown-v0"], gym.registry["Raising-v0"]


def generic(environment_id):
    bnf = "<if> ::= if lt(x0, [-1, 1] step 0.5) then <leaf> else <leaf>\n<leaf> ::= a0 | a1"
    unnamed = {"id": environment_id, "features": [], "units": [], "actions": [], "solved_at": None}
    return config(env=unnamed, grammar={"bnf": bnf}, ge={"generations": 3, "population_size": 6})


@pytest.mark.usefixtures("countdown")
def test_any_environment_runs_and_one_without_threshold_has_no_verdict(tmp_path):
    summary, output = run(generic("Countdown-v0"), tmp_path / "run")
    assert summary.solved is None
    assert summary.test_mean == 18.0, "the second action pays 6 for each of three steps"
    assert "no threshold" in output
    # Both branches pay best with the same action: pruning leaves one leaf.
    assert "always a1" in output


@pytest.mark.usefixtures("countdown")
def test_a_fault_of_the_environment_names_it_and_keeps_the_configuration(tmp_path):
    with pytest.raises(EnvironmentFaultError, match="the motor is on fire"):
        run(generic("Raising-v0"), tmp_path / "run")
    assert (tmp_path / "run" / "config.yaml").exists()
