"""Limits hold over a whole run: the first generation, refinement, validation and test are all within them."""

import re
import time

import pytest
from clocks_for_tests import OwnClock
from runs_for_tests import config, run
from walks_for_tests import BNF, SlowWalkEnv, registered

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.environments import mirroring, probing
from ge_torchrl.errors import UserError
from ge_torchrl.run import plan as planning

# All that a run can do, at sizes that no limit of these tests allows.
EVERYTHING = {
    "refiner": {"method": "cmaes", "schedule": {"every": 2}, "candidates": 2, "acceptance_episodes": 20},
    "archive": {
        "keep": 3, "episodes": 50, "neighbours": 4, "neighbours_drawn": 40, "revisit_factor": 2,
        "migrants": 4, "final_keep": 3, "final_factor": 5,
    },
}  # fmt: skip
ENDLESS = {"generations": 10_000, "population_size": 30, "genotype_length": 40, "gene_probability": 0.1}
MANY = {"episodes": 5, "validation_episodes": 2000, "test_episodes": 2000}


def limited(folder, ge, env=None, polish=None, **sections):
    """Run under a limit; return the summary and the seconds that it took in all, by a clock of its own."""
    sections = {**EVERYTHING, "evaluation": MANY, **sections, "ge": {**ENDLESS, **ge}}
    polish = {"every": 1, "max_timesteps": 20_000, **(polish or {})}
    if env is not None:
        sections.update(env=env, grammar={"bnf": BNF})
    with OwnClock().ticking():
        started = time.perf_counter()
        summary, _ = run(config(polish=polish, **sections), folder)
        seconds = time.perf_counter() - started
    assert RunFolder(folder).read_summary().stopped_by == summary.stopped_by
    assert RunFolder(folder).read_best_tree().tree is not None
    return summary, seconds


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A first run waits for kernels; how long that takes is not what is tested."""
    limited(tmp_path_factory.mktemp("compiled") / "run", {"generations": 3})


@pytest.mark.usefixtures("compiled")
class TestKernel:
    def test_seconds_hold(self, tmp_path):
        summary, seconds = limited(tmp_path / "run", {"max_seconds": 2.0})
        assert summary.stopped_by == "max_seconds"
        assert summary.generations > 1
        assert 1.2 < seconds <= 2.2

    def test_steps_hold_to_the_step_that_they_are_counted_by(self, tmp_path):
        summaries = [
            limited(
                tmp_path / str(threads), {"max_env_steps": 3_000_000}, evaluation={**MANY, "threads": threads}
            )[0]
            for threads in (1, 2)
        ]
        for summary in summaries:
            assert summary.stopped_by == "max_env_steps"
            assert summary.generations > 1
            assert 2_000_000 < summary.env_steps_total <= 3_300_000
            assert summary.refined > 0 < summary.polished
        # Law 6 holds for a limit of steps too.
        assert summaries[0].steps == summaries[1].steps
        assert summaries[0].test_mean == summaries[1].test_mean

    def test_what_was_broken_off_and_what_found_no_room_is_told(self, tmp_path):
        ge = {**ENDLESS, "max_env_steps": 300_000}
        refiner = {**EVERYTHING["refiner"], "method": "ppo"}
        summary, shown = run(config(**{**EVERYTHING, "ge": ge, "refiner": refiner}), tmp_path / "run")
        told = f"ge.max_env_steps is near: generation {summary.generations} was broken off"
        assert told in shown
        # PPO of one tree would take more than there is: the search went on without it.
        assert (summary.refined, summary.warnings) == (
            0,
            ("ge.max_env_steps left no room to refine trees.",),
        )
        assert summary.generations > 3

    @pytest.mark.parametrize("max_env_steps", [300, 3_000, 30_000])
    def test_a_first_generation_may_be_cut_short(self, tmp_path, max_env_steps):
        summary, _ = limited(tmp_path / "run", {"max_env_steps": max_env_steps, "population_size": 5000})
        assert (summary.stopped_by, summary.generations) == ("max_env_steps", 1)
        assert summary.env_steps_total <= 1.1 * max_env_steps

    @pytest.mark.parametrize(
        ("limit", "enough"), [({"max_env_steps": 10}, r"\d+000"), ({"max_seconds": 1e-6}, r"\d+")]
    )
    def test_where_no_tree_can_be_measured_that_is_told_in_one_line(self, tmp_path, limit, enough):
        (name,) = limit
        told = (
            rf"ge\.{name}=10?.* must leave room for a first tree.*; type ge\.{name}=({enough}); no tree was"
        )
        with pytest.raises(UserError, match=told) as raised:
            limited(tmp_path / "run", limit)
        assert "\n" not in str(raised.value)
        (number,) = re.search(told, str(raised.value)).groups()
        summary, _ = limited(tmp_path / "again", {name: int(number)})
        assert summary.stopped_by == name

    def test_a_tree_that_there_is_no_room_to_test_is_saved(self, tmp_path, monkeypatch):
        monkeypatch.setattr("ge_torchrl.run.allowance._UTMOST", 1e-3)
        with pytest.raises(
            UserError, match=r"type ge\.max_env_steps=.*; the best tree so far is in .*, untested"
        ):
            limited(tmp_path / "run", {"max_env_steps": 3000})


@pytest.mark.usefixtures("compiled")
class TestSlowEnvironment:
    """A thousand steps a second, fifty steps an episode: each costs a part of a short limit."""

    FEW = {  # noqa: RUF012
        "refiner": {**EVERYTHING["refiner"], "acceptance_episodes": 2, "measuring_episodes": 1},
        "archive": {**EVERYTHING["archive"], "episodes": 2, "neighbours": 0},
        "polish": {"every": 0, "max_timesteps": 1000, "episodes": 2},
        "evaluation": {**MANY, "episodes": 1},
    }

    @pytest.fixture
    def slow(self, monkeypatch, tmp_path):
        with registered(SlowWalkEnv, max_episode_steps=50) as env:
            # The first run of its kind waits for kernels, and no limit counts that.
            with monkeypatch.context() as quick:
                quick.setattr(SlowWalkEnv, "seconds", 0.0)
                limited(tmp_path / "first", {"max_env_steps": 3000, "population_size": 10}, env, **self.FEW)
            yield env

    @pytest.mark.parametrize("population_size", [4, 2000])
    def test_seconds_hold(self, tmp_path, slow, population_size):
        ge = {"max_seconds": 10.0, "population_size": population_size}
        summary, seconds = limited(tmp_path / "run", ge, slow, **self.FEW)
        assert summary.stopped_by == "max_seconds"
        # Of many trees the first generation alone would take two minutes.
        assert (summary.generations == 1) == (population_size == 2000)
        assert 8.0 < seconds <= 10.2
        # Most of the time goes to the environment, and none of its steps is left out.
        assert 0.5 * seconds < summary.env_steps_total * SlowWalkEnv.seconds <= seconds

    def test_steps_hold(self, tmp_path, slow, monkeypatch):
        monkeypatch.setattr(SlowWalkEnv, "seconds", 0.0)
        ge = {"max_env_steps": 15_000, "population_size": 10}
        summary, _ = limited(tmp_path / "run", ge, slow, **self.FEW)
        assert summary.stopped_by == "max_env_steps"
        assert 10_500 < summary.env_steps_total <= 16_500
        assert summary.refined > 0

    @pytest.mark.parametrize(("workers", "max_env_steps"), [(1, 900), (1, 2000), (2, 900)])
    def test_few_steps_hold_where_episodes_are_long(
        self, tmp_path, slow, monkeypatch, workers, max_env_steps
    ):
        monkeypatch.setattr(SlowWalkEnv, "seconds", 0.0)
        ge, few = (
            {"max_env_steps": max_env_steps, "population_size": 10},
            {**self.FEW["evaluation"], "episodes": 8},
        )
        env = {**slow, "workers": workers}
        summary, _ = limited(tmp_path / "run", ge, env, **{**self.FEW, "evaluation": few})
        assert summary.stopped_by == "max_env_steps"
        assert summary.env_steps_total <= 1.1 * max_env_steps


def test_a_look_at_the_environment_is_within_the_seconds(tmp_path, monkeypatch):
    for module, memory in (
        (probing, "_probes"),
        (probing, "_obedient"),
        (mirroring, "_verdicts"),
        (planning, "_looked"),
    ):
        monkeypatch.setattr(module, memory, {})
    with registered(SlowWalkEnv, max_episode_steps=10) as env, OwnClock().ticking():
        monkeypatch.setattr(SlowWalkEnv, "seconds", 0.05)
        started = time.perf_counter()
        asked = config(
            env={**env, "symmetry": {"negate": ["x0"], "actions": {"a0": "a1"}}},
            grammar={"bnf": None},
            ge={**ENDLESS, "max_seconds": 30.0},
            evaluation={**MANY, "episodes": 2, "steps_per_second": None},
            archive=EVERYTHING["archive"],
        )
        # As the command line does it, to tell mistakes before a folder is made.
        planning.plan(asked)
        assert 2.0 < time.perf_counter() - started < 10.0
        summary, shown = run(asked, tmp_path / "run")
        seconds = time.perf_counter() - started
    assert summary.stopped_by == "max_seconds"
    assert 20.0 < seconds < 33.0
    assert summary.wall_seconds == pytest.approx(seconds, abs=2.0)
    assert "warning: env.symmetry is believed: Walk-v0 steps too slowly to try it." in shown
