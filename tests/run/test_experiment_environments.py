"""Runs of environments that are not ours."""

import gymnasium as gym
import pytest
from environments_for_tests import CountdownEnv
from faulty_environments import LateNaNEnv, RaisingEnv
from runs_for_tests import assert_untested, config, run
from walks_for_tests import BNF, registered

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.errors import EnvironmentFaultError
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
