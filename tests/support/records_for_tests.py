"""Records with plausible values, each of which a test may change."""

from ge_torchrl.records import Summary


def summary(**changes):
    values = {
        "environment": "CartPole-v1",
        "seed": 0,
        "solved": True,
        "train_fitness": 500.0,
        "validation_mean": 490.0,
        "test_mean": 487.4,
        "test_std": 12.345,
        "test_episodes": 100,
        "test_mean_full": 487.4,
        "decision_nodes": 3,
        "depth": 2,
        "complexity_M": 53.4,
        "generations": 200,
        "stopped_by": "generations",
        "env_steps": 10,
        "env_steps_total": 20,
        "refinements": 0,
        "refinements_improved": 0,
        "champion_from": "population",
        "evolve_seconds": 0.25,
        "refine_seconds": 0.0,
        "wall_seconds": 0.5,
        "invalid_fraction": 0.1,
        "route": "compiled",
        "solved_at": 475.0,
        "version": "0.1.0",
    }
    return Summary(**{**values, **changes})
