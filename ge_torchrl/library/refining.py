"""The numbers of one controller, made better as a run makes them better."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.checks import refuse
from ge_torchrl.config import Config
from ge_torchrl.config.composing import compose
from ge_torchrl.config.files import NO_ENVIRONMENT
from ge_torchrl.environments.choose import open_backend
from ge_torchrl.environments.plants.plant import names_plant
from ge_torchrl.errors import ConfigError
from ge_torchrl.library.controller import Controller
from ge_torchrl.report.reading import environment_of_tree
from ge_torchrl.report.tables import counted
from ge_torchrl.run.plan import plan
from ge_torchrl.run.refining import refiners_of, with_batches
from ge_torchrl.search.conclusion import TEST
from ge_torchrl.search.fitness import test_seeds, validation_seeds
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.proposals import KEPT, Proposal
from ge_torchrl.search.refinement import CLEARLY, MEASURING, is_clearly_better, refine_proposals
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

# The one generation that there is: in which both refiner and polish are due.
_GENERATION = 1


@dataclass(frozen=True, eq=False, repr=False)
class Refinement:
    """A controller and what refinement made of it.

    Attributes:
        controller: The refined one, or the one that was given where nothing clearly better was found.
        improved: Whether it is better, by three standard errors on episodes that nothing was trained on.
        returns_before: [E] float64, what the given one returned in each unseen episode of the test.
        returns_after: [E] float64, what `controller` returned in the same episodes.
    """

    controller: Controller
    improved: bool
    returns_before: NDArray[np.float64]
    returns_after: NDArray[np.float64]

    def __repr__(self) -> str:
        before, after = self.returns_before.mean(), self.returns_after.mean()
        told = f"improved, {before:.2f} -> {after:.2f}" if self.improved else f"not improved, {before:.2f}"
        episodes = counted(len(self.returns_after), "unseen episode")
        return f"{told} on {episodes}\n{self.controller!r}"

    def _repr_markdown_(self) -> str:
        return f"```text\n{self!r}\n```"


def refine(
    controller: Controller,
    *,
    seed: int = 0,
    refiner: str | None = None,
    polish: str | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Refinement:
    """Move the numbers of a controller to where it returns more; its structure stays.

    It is refined as a kept tree is in a run: by PPO, then by the polish where steps of the environment are nearly free,
    then put on the constants of the environment's grammar where it can say the tree.

    >>> import ge_torchrl as ge
    >>> start = ge.load("docs/trees/cartpole_two_decisions.json")
    >>> ge.refine(start, refiner="cmaes", settings={"polish.max_timesteps": 20_000}).improved  # 500 is the most
    False

    Args:
        controller: What is refined, in the environment that it names.
        seed: All randomness follows from it.
        refiner: "ppo" by default, or "cmaes": a local search without gradients, which loads no torch.
        polish: "none" does without the polish that follows PPO.
        settings: Others by their keys, as in `evolve`, such as `{"refiner.ppo.max_timesteps": 100_000}`.

    Raises:
        UserError: A value is not allowed, nothing is to refine, or the environment failed.
    """
    if not isinstance(controller, Controller):
        refuse("controller", controller, "a controller, such as ge.load(path) or result.champion gives")
    config = _config(controller, {"refiner": refiner, "polish": polish}, {"seed": seed, **(settings or {})})
    spec = environment_of_tree(controller)
    planned = plan(config)
    with closing(
        open_backend(spec, config.env.route, config.evaluation.threads, config.env.workers)
    ) as backend:
        speed = planned.config.evaluation.steps_per_second or backend.steps_per_second
        config = with_batches(planned.config.resolved(speed), backend)
        problem = Problem(config, planned.tables, backend, *refiners_of(config, backend), planned.mirror)
        if not problem.refines:
            raise ConfigError(
                f'refiner must be "ppo" or "cmaes", because the others refine nothing; got {refiner!r}'
            )
        proposal = Proposal(controller.tree, KEPT, 0.0)
        tree = refine_proposals(problem, [proposal], _GENERATION).refinements[0].tree
        before, after = _returns(problem, controller.tree, tree, validation_seeds(config), MEASURING)
        improved = is_clearly_better(after, before, CLEARLY)
        if not improved:
            tree = controller.tree
        before, after = _returns(problem, controller.tree, tree, test_seeds(config), TEST)
    provenance = (
        {**controller.provenance, "refined_by": config.refiner.method} if improved else controller.provenance
    )
    return Refinement(Controller(tree, controller.names, provenance), improved, before, after)


def _returns(
    problem: Problem, before: DecisionTree, after: DecisionTree, seeds: NDArray[np.int64], purpose: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    returns = problem.backend.evaluate(Forest.stack([before, after]), seeds, purpose).returns
    return returns[0], returns[1]


def _config(controller: Controller, chosen: Mapping[str, str | None], settings: Mapping[str, Any]) -> Config:
    """Return the configuration in which a controller is refined: its environment's, under the tree's own names."""
    names = controller.names
    own: dict[str, Any] = {
        "env.kwargs": names.kwargs,
        "env.wrappers": names.wrappers,
        "env.max_episode_steps": names.max_episode_steps,
        "refiner.schedule.generations": [_GENERATION],
    }
    config = compose(names.id, chosen, {**own, **settings})
    if (config.env.features, config.env.actions) == (names.features, names.actions):
        return config
    own |= {"env.features": names.features, "env.units": names.units, "env.actions": names.actions}
    if names_plant(names.id):
        return compose(names.id, chosen, {**own, **settings})
    return compose(NO_ENVIRONMENT, chosen, {"env.id": names.id, **own, **settings})
