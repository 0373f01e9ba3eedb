"""Runs of environments that are not ours."""

import re

import gymnasium as gym
import pytest
from environments_for_tests import CountdownEnv, UnseededEnv
from faulty_environments import (
    LATE_FAULTS,
    DyingLateEnv,
    LateFaultEnv,
    LateNaNEnv,
    RaisingEnv,
)
from runs_for_tests import assert_untested, config, run
from walks_for_tests import BNF, registered

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.environments import instances
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.report.evaluation import evaluate
from ge_torchrl.seeding import episode_seeds, stream


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

    def test_one_that_ignores_its_seeds_is_told_before_anything_else(self, tmp_path):
        with registered(UnseededEnv) as env:
            summary, output = run(own({**env, "max_episode_steps": 20}), tmp_path / "run")
        told = "Walk-v0 ignores reset(seed=...): the same seed gives another episode each time"
        assert output.splitlines()[1].startswith(f"warning: {told}")
        assert [warning.startswith(told) for warning in summary.warnings].count(True) == 1

    def test_arguments_and_limit_decide_the_route_and_travel_with_the_tree(self, tmp_path):
        """MountainCar with a goal that asks for speed, and twice the steps to reach it."""
        env = {"id": "MountainCar-v0", "features": [], "units": [], "actions": [], "solved_at": None}
        env |= {"kwargs": {"goal_velocity": 0.05}, "max_episode_steps": 400}
        always_left = {"bnf": "<if> ::= if lt(x0, [-4, 4] step 0.5) then a0 else a0"}
        tiny = config(
            env=env,
            grammar=always_left,
            ge={"generations": 1, "population_size": 2},
            evaluation={"episodes": 1, "validation_episodes": 2, "test_episodes": 2},
            archive={"episodes": 1},
        )
        summary, _ = run(tiny, tmp_path / "run")
        assert (summary.route, summary.test_mean) == ("gymnasium", -400)
        (tmp_path / "run" / "best_tree.json").rename(tmp_path / "elsewhere.json")
        again = evaluate(tmp_path / "elsewhere.json", 2, 0)
        assert (again.route, again.mean) == ("gymnasium", -400)

    @pytest.mark.parametrize(("asked", "recorded"), [(None, 2), (5, 5)])
    def test_batches_that_memory_decided_are_in_the_configuration(
        self, tmp_path, monkeypatch, asked, recorded
    ):
        monkeypatch.setattr(instances, "copies_that_fit", lambda _: 16)
        few = {"method": "ppo", "schedule": {"every": 0}, "ppo": {"trees_together": asked}}
        with registered(CountdownEnv) as env:
            run(own({**env, "max_episode_steps": 5}, refiner=few), tmp_path / "run")
        assert RunFolder(tmp_path / "run").read_config().refiner.ppo.trees_together == recorded

    @pytest.mark.parametrize(
        "fault", ["column", "long", "scalar", "array reward", "no reward", "infinite reward"]
    )
    def test_whatever_comes_back_is_told_in_one_line_and_the_best_tree_is_kept(self, tmp_path, fault):
        class Late(LateFaultEnv):
            """Breaks its word in the first test episode."""

            def reset(self, *, seed=None, options=None):
                first = int(episode_seeds("test", 5, stream(0, "test episodes"))[0])
                return super().reset(seed=9999 if seed == first else seed, options=options)

        Late.fault = fault
        with registered(Late) as env, pytest.raises(EnvironmentFaultError) as caught:
            run(own(env), tmp_path / "run")
        told = rf"env\.id=Walk-v0 {LATE_FAULTS[fault][2]}; episode seed \d+, step 2, action [01] \(a[01]\); "
        assert re.fullmatch(told + r"the best tree so far is in .*run, untested; .*", str(caught.value))
        assert_untested(RunFolder(tmp_path / "run"))

    def test_so_is_a_worker_that_dies(self, tmp_path):
        with (
            registered(DyingLateEnv) as env,
            pytest.raises(
                EnvironmentFaultError,
                match=r"worker process of env\.id=Walk-v0 died.*untested; .* goes on; details are in .*\.txt$",
            ),
        ):
            run(own({**env, "workers": 2}), tmp_path / "run")
        assert_untested(RunFolder(tmp_path / "run"))

    def test_an_entry_point_that_cannot_be_sent_is_told_before_anything_is_done(self, tmp_path):
        class Local(CountdownEnv):
            """No other process can import it."""

        with (
            registered(Local) as env,
            pytest.raises(
                EnvironmentFaultError, match=r'cannot be sent to worker.*"module:Class".*workers=1'
            ),
        ):
            run(own({**env, "workers": 2}), tmp_path / "run")
        assert not (tmp_path / "run").exists()
