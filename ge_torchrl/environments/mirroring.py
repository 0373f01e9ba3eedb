"""Whether an environment has the mirror that was declared.

Where its state can be set, mirrored states are stepped beside those they mirror: what follows has to be the mirror
image, at the same reward. Elsewhere small random trees act beside their images, each in episodes of its own. Of an
environment with a mirror both return the same on the average, and see the same but mirrored; what differs by more than
luck refutes the mirror. What does not differ proves nothing, but a search that believes it loses little.
"""

from __future__ import annotations

import itertools
import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.border import Border
from ge_torchrl.environments.mirror_episodes import LONGEST_EPISODE, SIGHTS, Played, episodes, sights
from ge_torchrl.environments.probing import Policy, random_tree
from ge_torchrl.environments.settable import Settable, Step, settable
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.environments.witness import Witness
from ge_torchrl.errors import ConfigError
from ge_torchrl.seeding import episode_seeds, stream

# Relative and absolute; simulators solve to about a millionth.
_TOLERANCE: Final = 1e-4
_TREES: Final = 12
_DEPTH: Final = 2
_EPISODES: Final = 40
# Of a state whose signs are all tried.
_MOST_ENTRIES: Final = 8
# Slow environments play fewer trees, but two at least where that takes no longer than the second figure [s].
_SECONDS, _LONGEST_SECONDS = 5.0, 20.0
# Of that, what is seen first may take so much.
_SIGHTS_SHARE: Final = 0.2
# Of fewer episodes standard errors tell little.
_FEWEST_EPISODES: Final = 10
# Standard errors of a difference. Of LunarLander's mirror, the largest of 200 comparisons was 2.2 to 3.3 in six checks.
_REFUTED_AT: Final = 5.0


# Of a state [N].
_Image = Callable[[NDArray[np.float64]], NDArray[np.float64]]


class Mirror(Protocol):
    """What observations and answers are in a mirror."""

    def observations(self, observations: NDArray[Any]) -> NDArray[Any]:
        """Return observations [..., D] in the mirror."""
        ...

    def answers(self, answers: NDArray[Any]) -> NDArray[Any]:
        """Return answers in the mirror: actions [B], or values [B, A]."""
        ...


@dataclass(frozen=True)
class Verdict:
    """What was found of a mirror.

    Attributes:
        found: What was compared, in words.
        fault: What refutes the mirror, with figures; empty where nothing does.
        is_tried: Whether enough was compared to tell.
    """

    found: str
    fault: str = ""
    is_tried: bool = True


_verdicts: dict[str, Verdict] = {}


def check_mirror(
    spec: EnvironmentSpec, symmetry: Mapping[str, Any], mirror: Mirror, seconds: float = math.inf
) -> Verdict:
    """Compare an environment with its mirror image; done once in a process.

    Args:
        spec: The environment.
        symmetry: What was declared.
        mirror: What that makes.
        seconds: How long it may take where that is less than usual [s].

    Raises:
        EnvironmentFaultError: The environment is at fault.
    """
    names = spec.names
    asked = json.dumps(
        [
            (names.id, names.kwargs, names.wrappers, names.max_episode_steps),
            (dict(symmetry), names.features, names.source, seconds),
        ],
        sort_keys=True,
    )
    if asked not in _verdicts:
        seconds = min(seconds, _LONGEST_SECONDS)
        opened = settable(spec, seconds)
        by_steps = None
        if opened is not None:
            with closing(opened):
                by_steps = _by_steps(spec, mirror, opened)
        _verdicts[asked] = by_steps or _by_returns(spec, mirror, seconds)
    return _verdicts[asked]


def refuse_what_is_refuted(verdict: Verdict) -> None:
    """Refuse a mirror that the environment does not have.

    Raises:
        ConfigError: It does not hold; the message says what was seen.
    """
    if verdict.fault:
        raise ConfigError(
            f"env.symmetry does not hold: {verdict.fault}; mend it, or type env.symmetry=null to do without"
        )


def _by_steps(spec: EnvironmentSpec, mirror: Mirror, environment: Settable) -> Verdict | None:
    """Step mirrored states; None where it is not known which states mirror each other."""
    fault = ""
    for image in _images_of_states(mirror, environment):
        found = _fault_of(spec, mirror, environment, image)
        if not found:
            return Verdict(f"{len(environment.steps)} steps from mirrored states came out mirrored")
        fault = fault or found
    return Verdict("", fault) if fault else None


def _images_of_states(mirror: Mirror, environment: Settable) -> Iterator[_Image]:
    """Yield what makes of a state [N] one of which the mirror image is observed.

    There are several where something of the state is not observed, and none where other states mirror each other.
    """
    steps = environment.steps
    if all(_is_state_itself(environment.observed(step.state), step.state) for step in steps):
        yield mirror.observations
        return
    n = len(steps[0].state)
    if n > _MOST_ENTRIES:
        return
    expected = mirror.observations(np.array([step.before for step in steps]))
    for signs in itertools.product((1.0, -1.0), repeat=n):
        seen = (environment.observed(step.state * np.array(signs)) for step in steps)
        if all(_is_close_throughout(one, other) for one, other in zip(expected, seen, strict=True)):
            yield partial(np.multiply, np.array(signs))


def _is_state_itself(observed: NDArray[np.float32], state: NDArray[np.float64]) -> bool:
    return np.array_equal(observed, state.astype(np.float32))


def _fault_of(spec: EnvironmentSpec, mirror: Mirror, environment: Settable, image_of: _Image) -> str:
    """Return what is not mirrored after a step from a mirrored state; an empty text where nothing is."""
    of = (*spec.names.features, "the reward", "the end of the episode")
    for step in environment.steps:
        image = environment.step_from(image_of(step.state), _answer(mirror, step.action))
        expected = (*mirror.observations(step.observation).tolist(), step.reward, float(step.terminated))
        came = (*image.observation.tolist(), image.reward, float(image.terminated))
        for name, one, other in zip(of, expected, came, strict=True):
            if not _is_close(one, other):
                return _different_steps(spec, step, image, name, one, other)
    return ""


def _different_steps(
    spec: EnvironmentSpec, step: Step, image: Step, name: str, expected: float, came: float
) -> str:
    pairs = zip(spec.names.features, step.before.tolist(), strict=True)
    state = ", ".join(f"{feature} = {value:.4g}" for feature, value in pairs)
    return (
        f"in the mirror of ({state}) and action {_told(spec, step.action)}, that is with action "
        f"{_told(spec, image.action)}, {name} has to become {expected:.6g} and becomes {came:.6g}"
    )


def _told(spec: EnvironmentSpec, action: Any) -> str:
    if not spec.is_continuous:
        return str(spec.names.actions[action])
    return ", ".join(f"{n} = {value:.4g}" for n, value in zip(spec.names.actions, action, strict=True))


def _by_returns(spec: EnvironmentSpec, mirror: Mirror, seconds: float) -> Verdict:
    """Let trees play beside their images in the mirror."""
    rng = stream(0, "trees before a mirror")
    seeds = iter(episode_seeds("training", 2 * _TREES * _EPISODES + SIGHTS, rng).tolist())
    started, n_trees, n_episodes = time.perf_counter(), 0, _EPISODES
    soon, late = started + min(_SECONDS, seconds), started + seconds
    with closing(Border(spec, Witness(spec))) as border:
        seen = list(sights(border, spec, rng, seeds, started + _SIGHTS_SHARE * seconds))
        while n_trees < _TREES and time.perf_counter() < (late if n_trees < 2 else soon):
            tree, half = random_tree(spec, rng, seen, _DEPTH), (time.perf_counter() + late) / 2
            own = episodes(border, tree, seeds, n_episodes, half)
            images = episodes(border, _image(tree, mirror), seeds, len(own.total), late)
            if len(images.total) < _FEWEST_EPISODES:
                break
            # What the image sees, mirrored back, is what the tree sees.
            images = Played(images.total, mirror.observations(images.mean), mirror.observations(images.last))
            if fault := _difference(spec.names.features, own, images):
                return Verdict("", fault)
            n_trees, n_episodes = n_trees + 1, len(images.total)
    if n_trees == 0:
        return Verdict(f"{spec.id} steps too slowly", is_tried=False)
    return Verdict(
        f"{n_trees} random trees and their images saw and returned alike, in {n_episodes} episodes each"
    )


def _image(tree: Policy, mirror: Mirror) -> Policy:
    return lambda observation: _answer(mirror, tree(mirror.observations(observation)))


def _answer(mirror: Mirror, action: Any) -> Any:
    """Return one action in the mirror: its number, or a list of values."""
    image = mirror.answers(np.array([action]))[0]
    return image.tolist()


def _difference(features: Sequence[str], own: Played, images: Played) -> str:
    """Return in what a tree and its image differ by more than luck; an empty text where in nothing."""
    seen = [f"{what} {name} =" for what in ("sees", "ends with") for name in features]
    columns = zip(*(np.concatenate(played, axis=1).T for played in (own, images)), strict=True)
    for what, (one, other) in zip(["returns", *seen], columns, strict=True):
        if standard_errors_apart(one, other) > _REFUTED_AT:
            return (
                f"a random tree {what} {one.mean():.5g} on the average and its image in the mirror "
                f"{other.mean():.5g}, in {len(one)} episodes of {LONGEST_EPISODE} steps at most, with standard errors "
                f"of {_error(one):.2g} and {_error(other):.2g}"
            )
    return ""


def standard_errors_apart(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return how many standard errors of the difference two means lie apart; 0 where they are equal.

    Args:
        one: [E] returns.
        other: [E] returns of other episodes.
    """
    difference = abs(float(one.mean() - other.mean()))
    # Where all episodes give nearly the same, sums differ by rounding.
    error = math.hypot(_error(one), _error(other), 1e-5 * max(1.0, abs(float(one.mean()))))
    return difference / error


def _error(values: NDArray[np.float64]) -> float:
    return float(values.std(ddof=1)) / math.sqrt(len(values))


def _is_close(one: float, other: float) -> bool:
    return abs(one - other) <= _TOLERANCE * max(1.0, abs(one))


def _is_close_throughout(one: NDArray[np.float32], other: NDArray[np.float32]) -> bool:
    return bool((np.abs(one - other) <= _TOLERANCE * np.maximum(1.0, np.abs(one))).all())
