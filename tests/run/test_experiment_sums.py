"""Whole runs of trees that weigh features, and of environments whose actions are numbers."""

import pytest
from runs_for_tests import assert_same_bytes, config, run

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.report.evaluation import evaluate

LITTLE_PPO = {"max_timesteps": 400, "update_timesteps": 200, "epochs": 2, "snapshot_episodes": 5}
PENDULUM = {"id": "Pendulum-v1", "features": [], "units": [], "actions": [], "solved_at": None}


def small(env=None, grammar=None, **sections):
    return config(
        **({} if env is None else {"env": env}),
        grammar={"bnf": None, **(grammar or {})},
        ge={"generations": 4, "population_size": 20, "genotype_length": 100},
        evaluation={"episodes": 3},
        refiner={"method": "ppo", "schedule": {"every": 2}, "ppo": LITTLE_PPO, "measuring_episodes": 5},
        polish={"every": 1, "max_timesteps": 5000, "episodes": 5},
        archive={"neighbours": 4, "neighbours_drawn": 20, "max_nodes": 3, "final_keep": 1, "final_factor": 1},
        starts={"races": 1, "count": 2, "max_timesteps": 20_000, "rounding_episodes": 20},
        **sections,
    )


@pytest.mark.parametrize(
    ("env", "grammar"),
    [
        (None, {"splits": "oblique"}),
        (PENDULUM, {}),
        (PENDULUM, {"leaves": "constant", "splits": "oblique"}),
    ],
)
def test_every_part_of_a_run_works_on_them_and_the_same_seed_gives_the_same_bytes(tmp_path, env, grammar):
    summary, _ = run(small(env, grammar), tmp_path / "one")
    run(small(env, grammar), tmp_path / "two")
    assert_same_bytes(tmp_path / "one", tmp_path / "two")
    assert summary.refined > 0
    assert summary.polished > 0
    assert {"refinement", "polish", "neighbours", "rounding"} <= set(summary.steps)
    assert RunFolder(tmp_path / "one").read_best_tree().tree.has_actions == (env is None)
    by_route = [evaluate(tmp_path / "one", 5, 7, route).mean for route in ("kernel", "gymnasium")]
    assert by_route[0] == pytest.approx(by_route[1], rel=1e-6)
