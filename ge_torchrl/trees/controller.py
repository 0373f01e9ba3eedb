"""A controller: a tree with the names that make it readable, and where it comes from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.printing import shortened
from ge_torchrl.trees.tree import DecisionTree, FloatArray

_LONGEST_NAME = 1000


@dataclass(frozen=True)
class Names:
    """An environment, as it is made, and the names of its features and actions.

    Attributes:
        id: Gymnasium id, such as `CartPole-v1`.
        features: [D] names of the observation's entries.
        units: [D] their units, an empty string where there is none.
        actions: [A] names of the actions; where leaves hold values, of the entries of an action.
        kwargs: What else the environment is made with: any JSON object. It is copied.
        wrappers: Wrappers around it, innermost first.
        max_episode_steps: Episode limit; None for the environment's own.
        action_bounds: (low, high) of each entry of a continuous action, infinite where there is none; empty where
            actions are numbers of choices. They are rounded to float32, as answers are.
        source: Digest of the file in which a user's own dynamics stand; empty where the environment is installed.

    Raises:
        InvalidTreeError: Features and units differ in number, there is no feature or action, the limit is below 1, the
            bounds are not one interval for each action, a name cannot be printed, or the arguments are no JSON.
    """

    id: str
    features: tuple[str, ...]
    units: tuple[str, ...]
    actions: tuple[str, ...]
    kwargs: Mapping[str, Any] = field(default_factory=dict, hash=False)
    wrappers: tuple[str, ...] = ()
    max_episode_steps: int | None = None
    action_bounds: tuple[tuple[float, float], ...] = ()
    source: str = ""

    def __post_init__(self) -> None:
        if len(self.features) != len(self.units):
            raise InvalidTreeError(
                f"environment.units: expected one for each feature (an empty string for none); "
                f"{self.id} has {len(self.features)} features and {len(self.units)} units"
            )
        for key in ("features", "units", "actions", "wrappers"):
            for place, text in enumerate(getattr(self, key)):
                _check_name(f"environment.{key}[{place}]", text)
        _check_name("environment.id", self.id)
        for key in ("features", "actions"):
            if not getattr(self, key):
                raise InvalidTreeError(f"environment.{key}: expected at least one name; {self.id} has none")
        if self.max_episode_steps is not None and self.max_episode_steps < 1:
            raise InvalidTreeError(
                f"environment.max_episode_steps: expected at least 1 or null, got {self.max_episode_steps}"
            )
        object.__setattr__(self, "action_bounds", _bounds_of(self.actions, self.action_bounds, self.id))
        object.__setattr__(self, "kwargs", _json_copy("environment.kwargs", self.kwargs))

    @property
    def environment(self) -> str:
        """The environment in words: its id, and in brackets what it is made with besides."""
        besides = [
            *(f"{key}={json.dumps(value)}" for key, value in self.kwargs.items()),
            *(wrapper.partition(":")[2] or wrapper for wrapper in self.wrappers),
            *([] if self.max_episode_steps is None else [f"{self.max_episode_steps} steps"]),
        ]
        return f"{self.id} ({', '.join(besides)})" if besides else self.id

    @property
    def action_spread(self) -> NDArray[np.float64]:
        """[A] float64, half of the distance between an action's bounds; 1 where it tells nothing."""
        low, high = np.array(self.action_bounds or [(-np.inf, np.inf)] * len(self.actions)).T
        half = (high - low) / 2
        return np.where(np.isfinite(half) & (half > 0), half, 1.0)


@dataclass(frozen=True)
class Controller:
    """A tree with its names: what decides, is saved, drawn and played.

    Attributes:
        tree: The tree.
        names: The environment and the names of its features and actions.
        provenance: Where the tree comes from (run, seed, generation, ...): any JSON object. It is copied.

    Raises:
        InvalidTreeError: The tree does not fit the names, or the provenance is no JSON.
    """

    tree: DecisionTree
    names: Names
    provenance: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        check_names(self.tree, self.names)
        object.__setattr__(self, "provenance", _json_copy("provenance", self.provenance))

    def __call__(self, observation: ArrayLike) -> int | FloatArray:
        """Return the answer to one observation.

        Args:
            observation: [D], taken as float32.

        Returns:
            The number of the action, counted from 0; where leaves hold values, [A] float32, clipped to the bounds of
            the environment's actions.

        Raises:
            ValueError: The observation has another shape.
        """
        with np.errstate(over="ignore"):
            observed = np.asarray(observation, dtype=np.float32)
        if observed.shape != (len(self.names.features),):
            raise ValueError(
                f"{self.names.id} is observed by {len(self.names.features)} features; "
                f"this observation has shape {list(observed.shape)}"
            )
        answer = self.decide(observed[np.newaxis])[0]
        return int(answer) if self.tree.has_actions else answer

    def decide(self, observations: FloatArray) -> NDArray[Any]:
        """Return the answers to many observations.

        Args:
            observations: [N, D] float32.

        Returns:
            [N] numbers of actions; where leaves hold values, [N, A] float32, clipped to the bounds of the actions.
        """
        answers = self.tree.decide(observations)
        if self.tree.has_actions:
            return answers
        low, high = np.array(self.names.action_bounds or [(-np.inf, np.inf)], np.float32).T
        clipped: FloatArray = np.clip(answers, low, high)
        return clipped


def check_names(tree: DecisionTree, names: Names) -> None:
    """Refuse a tree that uses a feature or an action that the names do not have.

    Raises:
        InvalidTreeError: It does; the message says where.
    """
    for what, owners, used, known in (
        ("splits", tree.term_start, tree.feature, names.features),
        ("leaves", tree.leaf_term_start, tree.leaf_feature, names.features),
        ("leaves", np.arange(len(tree.action) + 1), tree.action, names.actions),
    ):
        if used.max(initial=-1) >= len(known):
            place = int(np.argmax(used))
            owner = int(np.searchsorted(owners, place, side="right")) - 1
            noun = "actions" if used is tree.action else "features"
            raise InvalidTreeError(
                f"{what}[{owner}]: {names.id} has {noun} 0 to {len(known) - 1}, not {used[place]}"
            )
    if tree.has_actions and names.action_bounds:
        raise InvalidTreeError(
            f"leaves[0].action: {names.id} takes {len(names.actions)} values within bounds, not the number of an action"
        )
    if not tree.has_actions and tree.value.shape[1] != len(names.actions):
        raise InvalidTreeError(
            f"leaves[0].value: {names.id} takes {len(names.actions)} values, not {tree.value.shape[1]}"
        )


def _check_name(key: str, text: str) -> None:
    """Refuse what a person cannot read in a table: what a terminal obeys, and what is too long."""
    if not text.isprintable() or len(text) > _LONGEST_NAME:
        raise InvalidTreeError(
            f"{key}: expected one line of at most {_LONGEST_NAME} printable characters, got {shortened(repr(text))}"
        )


def _bounds_of(
    actions: tuple[str, ...], bounds: tuple[tuple[float, float], ...], environment_id: str
) -> tuple[tuple[float, float], ...]:
    """Return bounds as float32 values; refuse what is not one interval for each action."""
    if bounds and len(bounds) != len(actions):
        raise InvalidTreeError(
            f"environment.action_bounds: expected one pair for each of the {len(actions)} actions of "
            f"{environment_id}, got {len(bounds)}"
        )
    with np.errstate(over="ignore"):
        rounded = tuple((float(np.float32(low)), float(np.float32(high))) for low, high in bounds)
    for place, (low, high) in enumerate(rounded):
        if not (low <= high and low < np.inf and high > -np.inf):
            raise InvalidTreeError(
                f"environment.action_bounds[{place}]: expected a least and a greatest value, in this order, "
                f"got {low} and {high}"
            )
    return rounded


def _json_copy(key: str, value: Mapping[str, Any]) -> dict[str, Any]:
    try:
        copied: dict[str, Any] = json.loads(json.dumps(dict(value), allow_nan=False))
    except (TypeError, ValueError, RecursionError) as error:
        raise InvalidTreeError(f"{key}: expected a JSON object of finite values, got {error}") from error
    return copied
