"""Whole runs of trees that weigh features, and of environments whose actions are numbers."""

from dataclasses import replace

import pytest
from runs_for_tests import assert_same_bytes, config, run

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.environments.ledger import Limit
from ge_torchrl.report.evaluation import evaluate
from ge_torchrl.run import running
from ge_torchrl.search.archive import REFINEMENT, Contender
from ge_torchrl.search.rounding import round_kept

LITTLE_PPO = {"max_timesteps": 400, "update_timesteps": 200, "epochs": 2, "snapshot_episodes": 5}
PENDULUM = {"id": "Pendulum-v1", "features": [], "units": [], "actions": [], "solved_at": None}


def small(env=None, grammar=None, ge=None, archive=None, **sections):
    ge = {"generations": 4, "population_size": 20, "genotype_length": 100, **(ge or {})}
    neighbours = {"neighbours": 4, "neighbours_drawn": 20, "max_nodes": 3, "final_keep": 1, "final_factor": 1}
    return config(
        **({} if env is None else {"env": env}),
        grammar={"bnf": None, **(grammar or {})},
        ge=ge,
        evaluation={"episodes": 3},
        refiner={"method": "ppo", "schedule": {"every": 2}, "ppo": LITTLE_PPO, "measuring_episodes": 5},
        polish={"every": 1, "max_timesteps": 5000, "episodes": 5},
        archive={**neighbours, **(archive or {})},
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


def test_the_last_refinement_leaves_room_for_rounding(tmp_path):
    """However much the refinement would take."""
    settings = small(
        grammar={"splits": "oblique"},
        ge={"generations": 10_000, "max_env_steps": 2_000_000},
        archive={"max_nodes": 3, "final_keep": 3, "final_factor": 1000},
    )
    summary, _ = run(settings, tmp_path / "run")
    assert summary.stopped_by == "max_env_steps"
    assert summary.steps["rounding"] > 0
    assert "ge.max_env_steps left no room to round the rules." not in summary.warnings


def test_no_tree_competes_with_its_rounded_self(tmp_path, monkeypatch):
    states = []

    def watched(problem, state):
        # Whether PPO betters a tree in so short a run is luck.
        refined = Contender(state.archive.members[-1].tree, 0.0, REFINEMENT)
        state = replace(state, best_refined=refined)
        states[:] = state, round_kept(problem, state)
        return states[1]

    monkeypatch.setattr(running, "round_kept", watched)
    run(small(PENDULUM), tmp_path / "run")
    before, after = states
    assert after.archive != before.archive
    assert after.best_refined is None


def test_rounding_that_had_no_room_is_told(tmp_path, monkeypatch):
    def all_that_is_left(problem, state):
        problem.backend.limit = Limit(max_env_steps=1)
        return round_kept(problem, state)

    monkeypatch.setattr(running, "round_kept", all_that_is_left)
    summary, shown = run(
        small(grammar={"splits": "oblique"}, ge={"max_env_steps": 2_000_000}), tmp_path / "run"
    )
    assert "ge.max_env_steps left no room to round the rules." in summary.warnings
    assert "warning: ge.max_env_steps left no room to round the rules." in shown


def test_ctrl_c_in_the_last_refinement_rounds_nothing(tmp_path, monkeypatch):
    def impatient(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "refine_once_more", impatient)
    summary, shown = run(small(grammar={"splits": "oblique"}), tmp_path / "run")
    assert "rounding" not in summary.steps
    assert "Rounding" not in shown
