"""Mirror symmetry: what states, answers and trees are in the mirror of an environment.

An environment is symmetric where mirroring a state and its action mirrors what follows, at the same reward. Then the
mirror image of a rule is as good as the rule, and a rule that is its own image is enough. Source: M. Zinkevich and
T. Balch, "Symmetry in Markov decision processes and its implications for single agent and multi-agent learning",
ICML 2001.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.errors import ConfigError
from ge_torchrl.trees.arrays import FloatArray
from ge_torchrl.trees.controller import Names
from ge_torchrl.trees.tree import DecisionTree

_KEYS: Final = ("negate", "swap", "actions", "negate_actions")


@dataclass(frozen=True, eq=False)
class Mirror:
    """The mirror of an environment; mirroring twice changes nothing.

    Attributes:
        feature: [D] int64; entry `i` of a mirrored observation is entry `feature[i]`, times `sign[i]`.
        sign: [D] float64, 1 or -1.
        action: [A] int64, what each action, or each entry of a Box action, is in the mirror.
        action_sign: [A] float64, 1 or -1: which entries of a Box action change their sign.
    """

    feature: NDArray[np.int64]
    sign: NDArray[np.float64]
    action: NDArray[np.int64]
    action_sign: NDArray[np.float64]

    @classmethod
    def declared(cls, symmetry: Mapping[str, Any], names: Names, key: str = "env.symmetry") -> Mirror:
        """Return the mirror that a setting, or a plant, declares.

        Args:
            symmetry: `negate`: names of features; `swap`: pairs of them; `actions`: pairs of actions, or of entries
                of a Box action, that are each other's image; `negate_actions`: entries of a Box action.
            names: Of the environment.
            key: What the user calls the declaration.

        Raises:
            ConfigError: A key or a name is unknown, a value is of another form, or an entry stands in two places.
        """
        unknown = set(symmetry) - set(_KEYS)
        if unknown:
            raise ConfigError(
                f"{key} has the keys {', '.join(_KEYS)}; {', '.join(sorted(unknown))} is not one of them"
            )
        feature, sign = _involution(names.features, symmetry, key, "swap", "negate")
        action, action_sign = _involution(names.actions, symmetry, key, "actions", "negate_actions")
        if not names.action_bounds and (action_sign < 0).any():
            raise ConfigError(f"{key}.negate_actions is for continuous actions; type {key}.actions instead")
        return cls(feature, sign, action, action_sign)

    def changes_sign(self, feature: int) -> bool:
        """Tell whether a feature keeps its place in the mirror, and changes its sign."""
        return bool(self.feature[feature] == feature and self.sign[feature] < 0)

    def observations(self, observations: FloatArray) -> FloatArray:
        """Return observations [..., D] in the mirror."""
        mirrored: FloatArray = observations[..., self.feature] * self.sign.astype(np.float32)
        return mirrored

    def weights(self, weights: Mapping[int, float]) -> dict[int, float]:
        """Return the weights, by feature, of a sum that is in a state what the given one is in the mirrored state."""
        return {int(self.feature[f]): float(w * self.sign[f]) for f, w in weights.items()}

    def tree(self, tree: DecisionTree) -> DecisionTree:
        """Return a tree in the mirror: it answers to a mirrored state the mirrored answer."""
        arrays = tree.arrays
        leaf_weight = arrays.leaf_weight * self.sign[arrays.leaf_feature, np.newaxis]
        if not tree.has_actions:
            arrays = arrays._replace(
                value=(arrays.value[:, self.action] * self.action_sign).astype(np.float32),
                leaf_feature=self.feature[arrays.leaf_feature].astype(np.int32),
                leaf_weight=(leaf_weight[:, self.action] * self.action_sign).astype(np.float32),
            )
        return DecisionTree(
            *arrays._replace(
                feature=self.feature[arrays.feature].astype(np.int32),
                weight=(arrays.weight * self.sign[arrays.feature]).astype(np.float32),
                action=self.action[arrays.action].astype(np.int32),
            )
        )

    def answers(self, answers: NDArray[Any]) -> NDArray[Any]:
        """Return the answers of a tree in the mirror: actions [B], or values [B, A]."""
        if answers.ndim == 1:
            actions: NDArray[Any] = self.action[answers]
            return actions
        mirrored: NDArray[Any] = answers[:, self.action] * self.action_sign.astype(answers.dtype)
        return mirrored


def _involution(
    names: Sequence[str], symmetry: Mapping[str, Any], key: str, swap: str, negate: str
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return which entry each entry is in the mirror, and with which sign."""
    place = {name: number for number, name in enumerate(names)}
    entry, sign = np.arange(len(names)), np.ones(len(names))
    seen: set[str] = set()
    for pair in _pairs(symmetry, key, swap, names):
        one, other = (_known(name, place, f"{key}.{swap}") for name in pair)
        if seen & set(pair) or one == other:
            raise ConfigError(f"{key}.{swap} names an entry once; {' and '.join(pair)} are named again")
        seen.update(pair)
        entry[one], entry[other] = other, one
    negated = symmetry.get(negate, ())
    if not _is_list(negated):
        example = negated if isinstance(negated, str) and negated in place else names[0]
        raise ConfigError(
            f"{key}.{negate} must be a list of names, such as {negate}: [{example}]; got {_typed(negated)}"
        )
    for name in negated:
        sign[_known(name, place, f"{key}.{negate}")] = -1.0
    if not (sign[entry] == sign).all():
        raise ConfigError(
            f"{key}.{negate}: of two that change places by {key}.{swap} both or none change their sign"
        )
    return entry, sign


def _pairs(symmetry: Mapping[str, Any], key: str, swap: str, names: Sequence[str]) -> list[Sequence[Any]]:
    """Return the pairs that change places; of actions they may be keys with values."""
    given = symmetry.get(swap, ())
    is_mapping = isinstance(given, Mapping)
    if is_mapping and swap == "actions":
        return list(given.items())
    if not _is_list(given) or not all(_is_list(pair) and len(pair) == 2 for pair in given):
        typed = [name for pair in given.items() for name in pair] if is_mapping else given
        is_pair = _is_list(typed) and len(typed) == 2 and all(name in names for name in typed)
        one, other = typed if is_pair else (names[0], names[-1])
        of_command_line = f"; type {key}.{swap}='[[{one},{other}]]'" if key == "env.symmetry" else ""
        raise ConfigError(
            f"{key}.{swap} takes pairs of names, such as {swap}: [[{one}, {other}]]; "
            f"got {_typed(given)}{of_command_line}"
        )
    return list(given)


def _is_list(given: Any) -> bool:
    return isinstance(given, Sequence) and not isinstance(given, str)


def _typed(given: Any) -> str:
    return "null" if given is None else repr(given)


def _known(name: Any, place: Mapping[str, int], key: str) -> int:
    if not isinstance(name, str) or name not in place:
        raise ConfigError(f"{key}: {name!r} is none of the names {', '.join(place)}")
    return place[name]
