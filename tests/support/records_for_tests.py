"""Records with plausible values, each of which a test may change."""

from ge_torchrl.artefacts.records import ArchiveRecord, GenerationRecord, RefinementRecord, Summary


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
        "steps": {"fitness": 10, "test": 10},
        "steps_per_second": 1e8,
        "refinements": 0,
        "refinements_improved": 0,
        "refined": 0,
        "polished": 0,
        "champion_from": "population",
        "evolve_seconds": 0.25,
        "refine_seconds": 0.0,
        "polish_seconds": 0.0,
        "wall_seconds": 0.5,
        "invalid_fraction": 0.1,
        "route": "kernel",
        "solved_at": 475.0,
        "version": "0.1.0",
    }
    return Summary(**{**values, **changes})


def generation(number, best, best_refined=None, steps=1000, **changes):
    """A generation after which the run has taken `steps` environment steps for each so far."""
    values = {
        "generation": number,
        "best_fitness": best,
        "best_refined": best_refined,
        "median_fitness": 9.4,
        "mean_fitness": 20.0,
        "best_decision_nodes": 2,
        "born": 20,
        "invalid": 1,
        "env_steps": steps * (number + 1),
        "elapsed_seconds": 0.5 * (number + 1),
        "evaluation_seconds": 0.4,
        "variation_seconds": 0.1,
    }
    return GenerationRecord(**{**values, **changes})


def history(best, refined=(), steps=1000):
    """Records of these best fitnesses; `refined` holds the first values of `best_refined`, then its last one."""
    refined = [*refined, *[refined[-1] if refined else None] * (len(best) - len(refined))]
    return [
        generation(number, *values, steps) for number, values in enumerate(zip(best, refined, strict=True))
    ]


def refinement(number=40, *, before=100.0, again=90.0, after=480.0, **changes):
    """A refinement; `before` on the training episodes, `again` and `after` on the unseen ones."""
    values = {
        "generation": number,
        "outcome": "improved" if after > again else "not_improved",
        "chosen": "random",
        "redraws": 1,
        "individual": 7,
        "decision_nodes": 3,
        "fitness_before": before,
        "return_before": again,
        "soft_return": 200.0,
        "return_after": after,
        "new_best": before is not None and after > before,
        "parameters_moved": 1,
        "largest_parameter_move": 0.02,
        "leaves_changed": 2,
        "timesteps": 100_000,
        "updates": 33,
        "gradient_steps": 1980,
        "actor_loss": -0.01,
        "critic_loss": 3.0,
        "entropy": 0.3,
        "clip_fraction": 0.1,
        "kl": 0.01,
        "refine_seconds": 1.0,
    }
    return RefinementRecord(**{**values, **changes})


def proposal(number=40, *, origin="neighbour", again=90.0, after=480.0, **changes):
    """A refinement of a tree that the archive proposed."""
    nothing = dict.fromkeys(("chosen", "individual"))
    return refinement(number, before=None, again=again, after=after, origin=origin, **{**nothing, **changes})


def skipped(number=40):
    return RefinementRecord(generation=number, outcome="skipped", redraws=20)


def kept(decision_nodes, test_mean, *, validation_mean=None, **changes):
    """The best tree of one size."""
    values = {
        "decision_nodes": decision_nodes,
        "depth": decision_nodes,
        "complexity_M": 17.8 * decision_nodes,
        "archive_mean": test_mean,
        "validation_mean": test_mean if validation_mean is None else validation_mean,
        "test_mean": test_mean,
        "test_std": 1.5,
        "origin": "population",
    }
    return ArchiveRecord(**{**values, **changes})
