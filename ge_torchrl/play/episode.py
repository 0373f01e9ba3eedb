"""An episode step by step: what was observed, which way through the tree it took, and what was done."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.border import Border
from ge_torchrl.environments.choose import open_backend
from ge_torchrl.environments.plants.plant import names_plant
from ge_torchrl.environments.spec import EnvironmentSpec, make_gymnasium
from ge_torchrl.environments.witness import Witness
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

Which = Literal["best", "median", "worst"]
"""An episode chosen among `CHOSEN_FROM`."""
CHOSEN_FROM = 100

_RENDER_MODE = "rgb_array"
_FRAMES_PER_SECOND = 30.0


@dataclass(frozen=True)
class Passed:
    """A split on the way through a tree.

    Attributes:
        split: Its number.
        value: The sum that it compares with its threshold.
        is_true: Whether the sum is below it.
    """

    split: int
    value: float
    is_true: bool


@dataclass(frozen=True, eq=False)
class Moment:
    """A state, and what the tree does there.

    Attributes:
        step: Steps made before.
        observation: [D] float32.
        path: The splits that the observation passes, from the root on.
        leaf: The leaf where they end.
        answer: What is done there: the number of the action, or its entries [A], cut to their bounds.
        total: Sum of the rewards before.
        ended: Why there is no step from here, in words; empty where there is one.
        picture: [height, width, 3] uint8, what the environment draws; None where it was not asked.
    """

    step: int
    observation: NDArray[np.float32]
    path: tuple[Passed, ...]
    leaf: int
    answer: int | tuple[float, ...]
    total: float
    ended: str
    picture: NDArray[np.uint8] | None


def moments(
    controller: Controller,
    spec: EnvironmentSpec,
    seed: int,
    most: int,
    is_drawn: Callable[[int], bool] | None,
) -> Iterator[Moment]:
    """Play an episode and yield every state of it, the last one too.

    Args:
        controller: Decides.
        spec: The environment.
        seed: The episode is that of `reset(seed=seed)`.
        most: So many steps at most.
        is_drawn: Whether the state after so many steps is drawn; the last one always is. None draws none.

    Raises:
        EnvironmentFaultError: The environment failed.
    """
    render_mode = None if is_drawn is None else _RENDER_MODE
    with closing(Border(spec, Witness(spec), render_mode)) as border:
        border.reset(seed)
        total, step, ended = 0.0, 0, ""
        while True:
            observation = border.array.copy()
            path, leaf = way_through(controller.tree, observation)
            picture = None
            if is_drawn is not None and (ended or is_drawn(step)):
                picture = np.asarray(border.render(), np.uint8)
            answer = controller(observation)
            told = answer if isinstance(answer, int) else tuple(answer.tolist())
            yield Moment(step, observation, path, leaf, told, total, ended, picture)
            if ended:
                return
            _, reward, terminated, truncated = border.step(told if isinstance(told, int) else list(told))
            total, step = total + reward, step + 1
            if terminated or truncated:
                ended = "ended by the task" if terminated else "ended by its limit"
            elif step == most:
                ended = f"shown up to step {most}"


def way_through(tree: DecisionTree, observation: NDArray[np.float32]) -> tuple[tuple[Passed, ...], int]:
    """Return the splits that an observation [D] passes, and the leaf where it ends."""
    path, node = [], 0 if tree.num_decision_nodes else ~0
    while node >= 0:
        value = 0.0
        # As everywhere else: in float64, and in the order of the terms.
        with np.errstate(over="ignore", invalid="ignore"):
            for term in range(tree.term_start[node], tree.term_start[node + 1]):
                value += float(tree.weight[term]) * float(observation[tree.feature[term]])
        is_true = value < float(tree.threshold[node])
        path.append(Passed(node, value, is_true))
        node = int((tree.children_left if is_true else tree.children_right)[node])
    return tuple(path), ~node


def chosen_seed(tree: DecisionTree, spec: EnvironmentSpec, seed: int, which: Which) -> int:
    """Return the seed of the best, the median or the worst of the `CHOSEN_FROM` episodes from `seed` on, by return."""
    with closing(open_backend(spec)) as backend:
        seeds = np.arange(seed, seed + CHOSEN_FROM)
        returns = backend.evaluate(Forest.stack([tree]), seeds, "test").returns[0]
    order = np.argsort(returns, kind="stable")
    return seed + int(order[{"worst": 0, "median": CHOSEN_FROM // 2, "best": CHOSEN_FROM - 1}[which]])


def frames_per_second(spec: EnvironmentSpec) -> float | None:
    """Return how many states a second its pictures show; None where an environment draws none."""
    if names_plant(spec.id):
        return None
    with closing(make_gymnasium(spec)) as environment:
        metadata: dict[str, Any] = environment.metadata or {}
    if _RENDER_MODE not in (metadata.get("render_modes") or ()):
        return None
    return float(metadata.get("render_fps") or _FRAMES_PER_SECOND)
