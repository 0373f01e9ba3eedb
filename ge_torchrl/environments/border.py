"""The border of a Gymnasium environment: what comes over it is checked, float32, and counted from 0.

Every way to step Gymnasium goes through here, so a fault reads the same everywhere: what, seed, step, action.
"""

from __future__ import annotations

import logging
import math
from typing import Any, TypeAlias

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.hangs import unwatch, watch
from ge_torchrl.environments.lean import lean
from ge_torchrl.environments.making import FAULTS
from ge_torchrl.environments.plants.plant import names_plant
from ge_torchrl.environments.spec import EnvironmentSpec, make_gymnasium
from ge_torchrl.environments.suitable import one_line
from ge_torchrl.environments.witness import Witness
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.interrupts import interrupt_heard
from ge_torchrl.printing import said_of

_logger = logging.getLogger(__name__)
_FLOAT32 = np.dtype(np.float32)
_LARGEST = float(np.finfo(np.float32).max)
# Floats, integers, unsigned ones, Booleans.
_KINDS_OF_NUMBERS = "fiub"
_SCALARS = (int, np.float64, np.float32)


# A number, counted from 0, or the entries of a continuous action, [A].
Action: TypeAlias = int | list[float]


def random_action(spec: EnvironmentSpec, rng: np.random.Generator) -> Action:
    """Draw an action, uniform; normal in an entry that lacks a bound, and cut to the one that it has.

    Args:
        spec: The environment.
        rng: Source of randomness.
    """
    if not spec.is_continuous:
        return int(rng.integers(spec.n_actions))
    return [
        float(rng.uniform(low, high) if math.isfinite(high - low) else min(max(rng.normal(), low), high))
        for low, high in spec.names.action_bounds
    ]


_STEP_FORM = "an observation, a reward, terminated, truncated and a dict"


class Border:
    """One environment, made by the description, stepped the lean way.

    Args:
        spec: The environment.
        witness: Who is told what the environment had not said; shared between borders.
        render_mode: As `gym.make` takes it; None where nothing is drawn.

    Attributes:
        array: [D] float32, the last observation; may be the environment's own array, so it is to be copied.
        step_number: Steps since the reset.
        action_bounds: [A] what the entries of a continuous action are cut to.
        step_seconds: How long a call of the environment may take [s].
        is_hung: Whether one took longer, so that it was interrupted.
    """

    def __init__(self, spec: EnvironmentSpec, witness: Witness, render_mode: str | None = None) -> None:
        self._spec = spec
        self.step_seconds, self.is_hung = spec.step_seconds, False
        self._seed = 0
        self._action: Any = None
        self.step_number = 0
        self.watched_by(witness)
        watch(self, Border.__init__, Border.reset, Border.step, Border.close)
        try:
            self._environment: Any = make_gymnasium(spec, render_mode=render_mode)
        except KeyboardInterrupt as pressed:
            raise self._fault_or(pressed) from None
        self._lean_step, self._lean_reset, self._limit = lean(self._environment, spec.max_episode_steps)
        self._first_action = spec.first_action
        self._is_continuous = spec.is_continuous
        # What no float32 can hold is cut too.
        low, high = (np.clip(bound, -_LARGEST, _LARGEST) for bound in (spec.action_low, spec.action_high))
        self.action_bounds: list[tuple[float, float]] = list(zip(low.tolist(), high.tolist(), strict=True))
        self._action_type = self._environment.action_space.dtype
        self._shape = (spec.n_features,)
        self.array = np.zeros(self._shape, np.float32)

    def watched_by(self, witness: Witness) -> None:
        """Tell another witness from now on."""
        self._witness, self._checks = witness, witness.checks

    def reset(self, seed: int) -> list[float]:
        """Begin the episode of a seed; return its first observation [D], as Python numbers of float32 precision.

        Raises:
            EnvironmentFaultError: The environment raised, or observed nonsense.
        """
        self._seed, self._action, self.step_number = seed, None, 0
        try:
            observation, info = self._lean_reset(seed=seed)
        except FAULTS as error:
            form = " (an observation and a dict are expected of reset)" if _is_of_form(error) else ""
            raise self._fault(f"raised {said_of(error)} in reset{form}") from error
        except KeyboardInterrupt as pressed:
            raise self._fault_or(pressed) from None
        if not isinstance(info, dict) and getattr(observation, "shape", None) != self._shape:
            # An observation of two entries alone looks like a pair.
            raise self._fault(
                f"must return an observation and a dict from reset; got {_short((observation, info))}"
            )
        self.array = self._cast(observation)
        values: list[float] = self.array.tolist()
        self._note(values)
        return values

    def step(self, action: Action) -> tuple[list[float], float, bool, bool]:
        """Take an action: its number, counted from 0, or its entries [A], which are cut to their bounds.

        Returns:
            The observation [D], the reward, whether the task ended the episode, whether its limit did.

        Raises:
            EnvironmentFaultError: The environment raised, or gave nonsense back.
        """
        # One function, without calls of our own: its cost is that of every step of every episode.
        self._action = action
        given: Any = self._array_of(action) if self._is_continuous else action + self._first_action  # type: ignore[arg-type, operator]
        try:
            observation, reward, terminated, truncated, _ = self._lean_step(given)
        except FAULTS as error:
            form = f" ({_STEP_FORM} are expected of step)" if _is_of_form(error) else ""
            raise self._fault(f"raised {said_of(error)}{form}") from error
        except KeyboardInterrupt as pressed:
            raise self._fault_or(pressed) from None
        number = reward if type(reward) is float else self._number(reward)
        if number - number != 0.0:
            raise self._fault(f"returned a reward that is not a finite number, {number}")
        try:
            is_expected = observation.dtype is _FLOAT32 and observation.shape == self._shape
        except AttributeError:
            is_expected = False
        if not is_expected:
            observation = self._cast(observation)
        self.array = observation
        values: list[float] = observation.tolist()
        for feature, low, high in self._checks:
            if not low <= values[feature] <= high:
                self._note(values)
                break
        if terminated is not True and terminated is not False:
            terminated = self._truth(terminated)
        if truncated is not True and truncated is not False:
            truncated = self._truth(truncated)
        self.step_number = step_number = self.step_number + 1
        if step_number >= self._limit and not truncated:
            truncated = True
            if not self._spec.has_limit and not terminated:
                self._witness.is_endless = True
        return values, number, terminated, truncated

    def render(self) -> Any:
        """Return what the environment draws of its state, as its render mode says.

        Raises:
            EnvironmentFaultError: It raised, or a package that draws is missing.
        """
        try:
            # The wrappers that ask for the order of calls are passed by, as in steps.
            return self._environment.unwrapped.render()
        except gym.error.DependencyNotInstalled as error:
            raise EnvironmentFaultError(
                f"env.id={self._spec.id} is drawn by packages that are not installed ({one_line(error)}); "
                'expected them installed: pip install -c constraints.txt -e ".[play]"'
            ) from error
        except FAULTS as error:
            raise self._fault(f"raised {said_of(error)} in render") from error

    def close(self) -> None:
        """Close the environment, and let go of it: a simulator may be large, and who holds a border may live long."""
        environment, self._environment = self._environment, None
        if environment is not None:
            try:
                environment.close()
            except KeyboardInterrupt as pressed:
                if not self.is_hung:
                    raise
                # What ends it was told before.
                _logger.warning("%s", self._fault_or(pressed))
            del self._lean_step, self._lean_reset
        unwatch(self)

    def _array_of(self, action: list[float]) -> NDArray[Any]:
        # The bounds are float32: to round first would give the same. Environments keep and change what they are given,
        # so it is a new array each time.
        cut = [
            low if entry < low else high if entry > high else entry  # noqa: FURB136 (a call costs more)
            for entry, (low, high) in zip(action, self.action_bounds, strict=True)
        ]
        self._action = cut
        array = np.array(cut, np.float32)
        return array if self._action_type is _FLOAT32 else array.astype(self._action_type)

    def _note(self, values: list[float]) -> None:
        if any(math.isnan(value) for value in values):
            raise self._fault(f"returned an observation with NaN, {values}")
        self._witness.note(values)

    def _cast(self, observation: Any) -> NDArray[np.float32]:
        try:
            raw = np.asarray(observation)
        except ValueError:
            raw = np.asarray(None)
        if raw.dtype.kind not in _KINDS_OF_NUMBERS or raw.shape != self._shape:
            raise self._fault(
                f"must return observations of {self._shape[0]} numbers, as its observation space says; "
                f"got {_short(observation)}, of shape {raw.shape} and type {raw.dtype}"
            )
        if raw.dtype is _FLOAT32:
            return raw
        # What is beyond every float32 becomes infinite, and is reported as such.
        with np.errstate(over="ignore"):
            return raw.astype(np.float32)

    def _number(self, reward: Any) -> float:
        if type(reward) in _SCALARS:
            return float(reward)
        array = np.asarray(reward)
        if array.ndim > 0 or array.dtype.kind not in _KINDS_OF_NUMBERS:
            raise self._fault(f"must return a reward that is one number; got {_short(reward)}")
        return float(array)

    def _truth(self, value: Any) -> bool:
        try:
            return bool(value)
        except Exception as error:
            raise self._fault(
                f"must return whether the episode is over, as true or false; got {_short(value)}"
            ) from error

    def told_of_hang(self) -> str:
        """Return in one line which call has not come back; see `hangs`."""
        return self._told_of(
            f"must return from every call within {self.step_seconds:g} s, as env.step_seconds sets it; one has not"
        )

    def _fault_or(self, pressed: KeyboardInterrupt) -> BaseException:
        """Return the fault of a call that took too long; where none did, somebody pressed Ctrl-C."""
        return self._fault("") if self.is_hung else pressed

    def _fault(self, what: str) -> EnvironmentFaultError:
        """Return a fault with its place; whatever an environment makes of its interrupt, the hang is what is told."""
        if not self.is_hung:
            return EnvironmentFaultError(self._told_of(what))
        interrupt_heard()
        told, self.is_hung = self.told_of_hang(), False
        return EnvironmentFaultError(told)

    def _told_of(self, what: str) -> str:
        where = f"episode seed {self._seed}, step {self.step_number}"
        if self._action is not None:
            where += f", action {self._told(self._action)}"
        key = "env.dynamics" if names_plant(self._spec.id) else "env.id"
        return f"{key}={self._spec.id} {what}; {where}"

    def _told(self, action: Any) -> str:
        names = self._spec.names.actions
        if not self._is_continuous:
            return f"{action} ({names[action]})"
        return ", ".join(f"{name} = {entry:g}" for name, entry in zip(names, action, strict=True))


def _is_of_form(error: BaseException) -> bool:
    """Tell whether what was given back was of another number: as Gymnasium's predecessor has it, say."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    where = "" if trace is None else str(trace.tb_frame.f_globals.get("__name__"))
    # Within the environment's own code it is another mistake.
    return "unpack" in said_of(error) and where.startswith(("ge_torchrl.", "gymnasium."))


def _short(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."
