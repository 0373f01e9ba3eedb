"""The numbers of controllers, made better as a run makes them better."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any, overload

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
from ge_torchrl.library.keywords import keywords_told
from ge_torchrl.report.reading import environment_of_tree
from ge_torchrl.report.tables import counted
from ge_torchrl.run.plan import plan
from ge_torchrl.run.refining import refiners_of, with_batches
from ge_torchrl.search.conclusion import TEST
from ge_torchrl.search.fitness import test_seeds, validation_seeds
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.proposals import KEPT, Proposal
from ge_torchrl.search.refinement import CLEARLY, MEASURING, is_clearly_better, refine_proposals
from ge_torchrl.search.rounding import rounded
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

# The one generation that there is: in which both refiner and polish are due.
_GENERATION = 1
_ONE_OR_SEVERAL = "a controller, such as ge.load(path) or result.champion gives, or a list of them"


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


@overload
def refine(
    controller: Controller,
    *,
    seed: int = 0,
    refiner: str | None = None,
    polish: str | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Refinement: ...


@overload
def refine(
    controller: Iterable[Controller],
    *,
    seed: int = 0,
    refiner: str | None = None,
    polish: str | None = None,
    settings: Mapping[str, Any] | None = None,
) -> list[Refinement]: ...


@keywords_told
def refine(
    controller: Controller | Iterable[Controller],
    *,
    seed: int = 0,
    refiner: str | None = None,
    polish: str | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Refinement | list[Refinement]:
    """Move the numbers of a controller, or of several at once, to where they return more; structures stay.

    They are refined as kept trees are in a run: by PPO, then by the polish where steps of the environment are nearly
    free. Then they are put on the constants of the environment's grammar where it can say the tree, and sums are
    rounded to few terms and few digits.

    >>> import ge_torchrl as ge
    >>> start = ge.load("docs/trees/cartpole_two_decisions.json")
    >>> ge.refine(start, refiner="cmaes", settings={"polish.max_timesteps": 20_000}).improved  # 500 is the most
    False

    Args:
        controller: What is refined, in the environment that it names; or several, such as
            `result.controllers.values()`. PPO trains those of one environment as one batch, in which a tree takes a
            tenth of the time that it takes alone.
        seed: All randomness follows from it.
        refiner: "ppo" by default, or "cmaes": a local search without gradients, which loads no torch.
        polish: "none" does without the polish that follows PPO.
        settings: Others by their keys, as in `evolve`, such as `{"refiner.ppo.max_timesteps": 100_000}`.

    Returns:
        What refinement made of it; of several a list in their order.

    Raises:
        UserError: A value is not allowed, nothing is to refine, or the environment failed.
    """
    chosen, others = {"refiner": refiner, "polish": polish}, {"seed": seed, **(settings or {})}
    if isinstance(controller, Controller):
        return _refined([controller], chosen, others)[0]
    if not isinstance(controller, Iterable) or isinstance(controller, str | bytes | Mapping):
        refuse("controller", controller, _ONE_OR_SEVERAL)
    controllers = list(controller)
    for one in controllers:
        if not isinstance(one, Controller):
            refuse("controller", one, _ONE_OR_SEVERAL)
    refinements: dict[int, Refinement] = {}
    kinds = [(one.names, tuple(_sums_of(one.tree))) for one in controllers]
    for kind in dict.fromkeys(kinds):
        places = [place for place, other in enumerate(kinds) if other == kind]
        batch = _refined([controllers[place] for place in places], chosen, others)
        refinements.update(zip(places, batch, strict=True))
    return [refinements[place] for place in range(len(controllers))]


def _refined(
    controllers: Sequence[Controller], chosen: Mapping[str, str | None], settings: Mapping[str, Any]
) -> list[Refinement]:
    """Refine controllers of one environment as one batch."""
    config = _config(controllers[0], chosen, settings)
    spec = environment_of_tree(controllers[0])
    planned = plan(config)
    with closing(
        open_backend(spec, config.env.route, config.evaluation.threads, config.env.workers)
    ) as backend:
        speed = planned.config.evaluation.steps_per_second or backend.steps_per_second
        config = with_batches(
            planned.config.resolved(speed, has_sums=planned.tables.grammar.has_sums), backend
        )
        problem = Problem(config, planned.tables, backend, *refiners_of(config, backend), planned.mirror)
        if not problem.refines:
            raise ConfigError(
                f'refiner must be "ppo" or "cmaes", because the others refine nothing; got {chosen["refiner"]!r}'
            )
        trees = [controller.tree for controller in controllers]
        proposals = [Proposal(tree, KEPT, 0.0) for tree in trees]
        refinements = refine_proposals(problem, proposals, _GENERATION).refinements
        refined = [
            rounded(problem, refinement.tree, []) if refinement.is_changed else refinement.tree
            for refinement in refinements
        ]
        before, after = _returns(problem, trees, refined, validation_seeds(config), MEASURING)
        improved = [is_clearly_better(*returns, CLEARLY) for returns in zip(after, before, strict=True)]
        refined = [new if better else old for old, new, better in zip(trees, refined, improved, strict=True)]
        before, after = _returns(problem, trees, refined, test_seeds(config), TEST)
    return [
        Refinement(
            _improved(controller, tree, config.refiner.method) if better else controller, better, *returns
        )
        for controller, tree, better, *returns in zip(
            controllers, refined, improved, before, after, strict=True
        )
    ]


def _improved(controller: Controller, tree: DecisionTree, method: str) -> Controller:
    return Controller(tree, controller.names, {**controller.provenance, "refined_by": method})


def _returns(
    problem: Problem,
    before: Sequence[DecisionTree],
    after: Sequence[DecisionTree],
    seeds: NDArray[np.int64],
    purpose: str,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what trees return before and after, each [R, E]."""
    returns = problem.backend.evaluate(Forest.stack([*before, *after]), seeds, purpose).returns
    return returns[: len(before)], returns[len(before) :]


def _sums_of(tree: DecisionTree) -> dict[str, str]:
    """Return the settings of a grammar that can say the sums of a tree: a run with it rounds them."""
    splits = {} if tree.is_axis_aligned else {"grammar.splits": "oblique"}
    return splits | ({"grammar.leaves": "linear"} if len(tree.leaf_feature) else {})


def _config(controller: Controller, chosen: Mapping[str, str | None], settings: Mapping[str, Any]) -> Config:
    """Return the configuration in which a controller is refined: its environment's, under the tree's own names."""
    names = controller.names
    own: dict[str, Any] = {
        "env.kwargs": names.kwargs,
        "env.wrappers": names.wrappers,
        "env.max_episode_steps": names.max_episode_steps,
        "refiner.schedule.generations": [_GENERATION],
    }
    if not any(str(key).startswith("grammar.") for key in settings):
        own |= _sums_of(controller.tree)
    config = compose(names.id, chosen, {**own, **settings})
    if (config.env.features, config.env.actions) == (names.features, names.actions):
        return config
    own |= {"env.features": names.features, "env.units": names.units, "env.actions": names.actions}
    if names_plant(names.id):
        return compose(names.id, chosen, {**own, **settings})
    return compose(NO_ENVIRONMENT, chosen, {"env.id": names.id, **own, **settings})
