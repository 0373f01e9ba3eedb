"""A Gymnasium vector environment: many copies, stepped in this process and, where it pays, in others too.

Gymnasium's own `SyncVectorEnv` has one process, and `AsyncVectorEnv` one for each copy; here each process has its share
of the copies, and seeds, types and faults are those of the border.
"""

from __future__ import annotations

import ctypes
import itertools
import math
import multiprocessing
import signal
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from ge_torchrl.environments.backend import available_cores
from ge_torchrl.environments.border import Border, random_action
from ge_torchrl.environments.gymnasium_workers import spawning
from ge_torchrl.environments.sending import portable, unpack
from ge_torchrl.environments.shared_arrays import Arrays, Memory
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.environments.witness import Witness
from ge_torchrl.environments.worker_faults import Silence, Words, worker_died
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.seeding import episode_seeds

# Waking another process and waiting for it takes a tenth of this; a process has at least so much to do [s].
_SECONDS_WORTH_A_PROCESS = 0.5e-3

# An environment is tried out for so long to know what its steps cost [s].
_TRIAL_SECONDS = 0.02

# Whether a process at the other end still lives is looked after this often [s].
_WATCH_SECONDS = 1.0

_STEP, _RESET, _CLOSE = b"s", b"r", b"c"


class _Copies:
    """Copies of the environment in one process."""

    def __init__(self, spec: EnvironmentSpec, arrays: Arrays) -> None:
        witness = Witness(spec)
        self._borders = [Border(spec, witness) for _ in arrays.actions]
        self._arrays = arrays

    def step(self) -> None:
        observations, rewards, terminated, truncated = self._arrays.observations, [], [], []
        for i, (border, action) in enumerate(zip(self._borders, self._arrays.actions.tolist(), strict=True)):
            _, reward, has_terminated, is_truncated = border.step(action)
            observations[i] = border.array
            rewards.append(reward)
            terminated.append(has_terminated)
            truncated.append(is_truncated)
        self._arrays.rewards[:], self._arrays.terminated[:], self._arrays.truncated[:] = (
            rewards,
            terminated,
            truncated,
        )

    def reset(self) -> None:
        for i in np.flatnonzero(self._arrays.is_reset).tolist():
            self._borders[i].reset(int(self._arrays.seeds[i]))
            self._arrays.observations[i] = self._borders[i].array

    def close(self) -> None:
        for border in self._borders:
            border.close()


class VectorEnvironment(gym.vector.VectorEnv[NDArray[np.float32], NDArray[Any], NDArray[Any]]):
    """`n` copies of an environment; who steps them resets those that ended (autoreset is disabled).

    Observations are float32, and actions count from 0 or are float32 values of any size, whatever the environment
    says. Every episode begins by `reset(seed=...)` with a training seed that the copy's own generator draws, so what
    one copy does does not depend on the others, nor on the number of processes.

    Args:
        spec: The environment.
        rngs: [n] where each copy's episode seeds come from.
        workers: Number of processes; 0 means one for each core where that pays, 1 none but this one.

    Attributes:
        processes: Number of processes that step the copies; 1 is this one alone.

    Raises:
        EnvironmentFaultError: The environment is at fault; raised by `reset` and `step` too.
    """

    def __init__(self, spec: EnvironmentSpec, rngs: Sequence[np.random.Generator], workers: int = 0) -> None:
        n = len(rngs)
        self.num_envs = n
        self.autoreset_mode = AutoresetMode.DISABLED
        self.metadata = {"autoreset_mode": AutoresetMode.DISABLED}
        # What an environment declares may be untrue: nobody is to be misled by it, or to check it again.
        box = spaces.Box(-math.inf, math.inf, (spec.n_features,), np.float32)
        n_values = spec.n_actions if spec.is_continuous else 0
        # The border cuts values to their bounds: who draws them may go beyond.
        self.single_observation_space = box
        self.single_action_space = (
            spaces.Box(-math.inf, math.inf, (n_values,), np.float32)
            if n_values
            else spaces.Discrete(spec.n_actions)
        )
        self.observation_space = gym.vector.utils.batch_space(box, n)
        self.action_space = gym.vector.utils.batch_space(self.single_action_space, n)
        self._rngs = list(rngs)
        memory = Memory.empty(n, spec.n_features, n_values)
        self._arrays = memory.arrays()
        self.processes = min(workers or _paying_processes(spec, n), n)
        edges = np.linspace(0, n, self.processes + 1).astype(int).tolist()
        self._others = [_Other(spec, memory, first, end) for first, end in itertools.pairwise(edges[1:])]
        self._copies = _Copies(spec, self._arrays.part(0, edges[1]))

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin new episodes.

        Args:
            seed: Makes the copies' generators anew; None goes on with them.
            options: `reset_mask` [n] bool says which copies are reset; none means all.

        Returns:
            The observations [n, D] of all copies, and nothing else of interest.
        """
        if seed is not None:
            words = (
                [[seed, i] for i in range(self.num_envs)]
                if isinstance(seed, int)
                else [[s or 0] for s in seed]
            )
            self._rngs = [np.random.default_rng(word) for word in words]
        arrays = self._arrays
        arrays.is_reset[:] = True if options is None else options.get("reset_mask", True)
        for i in np.flatnonzero(arrays.is_reset).tolist():
            arrays.seeds[i] = episode_seeds("training", 1, self._rngs[i])[0]
        self._together(_RESET)
        return arrays.observations.copy(), {}

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[
        NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]
    ]:
        """Step all copies by actions [n], or by values [n, A]; see Gymnasium's `VectorEnv`."""
        arrays = self._arrays
        arrays.actions[:] = actions
        self._together(_STEP)
        return (
            arrays.observations.copy(),
            arrays.rewards.copy(),
            arrays.terminated.copy(),
            arrays.truncated.copy(),
            {},
        )

    def _together(self, order: bytes) -> None:
        for other in self._others:
            other.begin(order)
        try:
            self._copies.step() if order == _STEP else self._copies.reset()
        finally:
            # Every answer is read, so that an answer is never taken for that to a later order.
            faults = [other.end() for other in self._others]
        for fault in faults:
            if fault is not None:
                raise fault

    def close_extras(self, **_: Any) -> None:
        """End the processes and close the copies."""
        for other in self._others:
            other.close()
        self._copies.close()


class _Line(NamedTuple):
    """Orders to another process, and word that they are done; semaphores are four times as quick as a pipe.

    Attributes:
        order: What to do.
        is_fault: Not 0 where it could not be done: then the reason is in the pipe.
        begun: Released with an order.
        ended: Released when it is done.
        pipe: For faults alone; the end of this process.
        words: What is known of hangs.
    """

    order: Any
    is_fault: Any
    begun: Any
    ended: Any
    pipe: Connection
    words: Words


class _Other:
    """Another process with some of the copies."""

    def __init__(self, spec: EnvironmentSpec, memory: Memory, first: int, end: int) -> None:
        context = spawning()
        self._id, self._step_seconds = spec.id, spec.step_seconds
        ours, theirs = context.Pipe(duplex=False)
        self._line = _Line(
            context.RawValue(ctypes.c_char, _STEP),
            context.RawValue(ctypes.c_bool, False),
            context.Semaphore(0),
            context.Semaphore(0),
            ours,
            Words.empty(context, 1),
        )
        arguments = (portable(spec), memory, first, end, self._line._replace(pipe=theirs))
        self._process = context.Process(target=_serve, args=arguments, daemon=True)
        self._process.start()
        theirs.close()

    def begin(self, order: bytes) -> None:
        self._line.order.value = order
        self._line.begun.release()

    def end(self) -> Exception | None:
        silence = Silence(self._line.words, self._id, self._step_seconds)
        while not self._line.ended.acquire(timeout=_WATCH_SECONDS):
            if not self._process.is_alive():
                return worker_died(self._id, self._line.words)
            try:
                silence.check(_WATCH_SECONDS)
            except EnvironmentFaultError as hang:
                return hang
        fault: Exception | None = self._line.pipe.recv() if self._line.is_fault.value else None
        return fault

    def close(self) -> None:
        self.begin(_CLOSE)
        self._process.join(timeout=5)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._line.pipe.close()


def _serve(sent: bytes, memory: Memory, first: int, end: int, line: _Line) -> None:
    # Ctrl-C is for the calling process; where that is gone, this one ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    line.words.kept(0)
    parent = multiprocessing.parent_process()
    copies: _Copies | None = None
    while True:
        while not line.begun.acquire(timeout=_WATCH_SECONDS):
            if parent is None or not parent.is_alive():
                return
        if line.order.value == _CLOSE:
            break
        line.is_fault.value = False
        try:
            # Made with the first order, so that its faults reach the caller.
            if copies is None:
                copies = _Copies(unpack(sent), memory.arrays().part(first, end))
            copies.step() if line.order.value == _STEP else copies.reset()
        except EnvironmentFaultError as error:
            line.is_fault.value = True
            line.pipe.send(error)
        line.ended.release()
    if copies is not None:
        copies.close()


def _paying_processes(spec: EnvironmentSpec, n: int) -> int:
    """Return how many processes pay for `n` copies, after a short trial of one."""
    border, rng = Border(spec, Witness(spec)), np.random.default_rng(0)
    started, steps, ended = time.perf_counter(), 0, True
    while (elapsed := time.perf_counter() - started) < _TRIAL_SECONDS:
        if ended:
            border.reset(steps)
        _, _, terminated, truncated = border.step(random_action(spec, rng))
        ended = terminated or truncated
        steps += 1
    border.close()
    try:
        portable(spec)
    except EnvironmentFaultError:
        return 1
    return max(1, min(available_cores(), int(n * elapsed / steps / _SECONDS_WORTH_A_PROCESS)))
