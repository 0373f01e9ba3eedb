"""How fast a plant steps: its kernel on all cores, and a plain loop over its Gymnasium environment.

python tests/benchmarks/bench_plant.py docs/examples/plant.py:Cart
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import closing

import numpy as np

from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.kernel_choice import dynamics_of
from ge_torchrl.environments.kernel_probe import probing_trees
from ge_torchrl.environments.spec import EnvironmentSpec, describe, make_gymnasium

EPISODES, LOOP_STEPS, REPEATS = 200, 20_000, 5


def main(dynamics: str) -> None:
    """Print steps a second; others' work on the same cores is taken out by counting processor time too."""
    spec = describe(dynamics)
    loop, loop_cpu = _best(lambda: _loop(spec))
    print(f"{dynamics}, million steps a second")
    print(f"Gymnasium's loop            {loop / 1e6:8.3f}")
    trees = probing_trees(spec, dynamics_of(spec))
    with closing(KernelBackend(spec)) as kernel:
        kernel.evaluate(trees.take([0]), np.arange(32), "warm-up")
        clock, cpu = _best(lambda: kernel.evaluate(trees, np.arange(EPISODES), "bench").env_steps)
    print(f"kernel, all cores           {clock / 1e6:8.1f}   {clock / loop:5.0f} times the loop")
    print(f"kernel, of a processor second {cpu / 1e6:6.1f}   {cpu / loop_cpu:5.0f} times the loop")


def _best(play: Callable[[], int]) -> tuple[float, float]:
    """Return the best of a few: steps a second, and steps a second of processor time."""
    speeds = []
    for _ in range(REPEATS):
        clock, cpu = time.perf_counter(), time.process_time()
        steps = play()
        speeds.append((steps / (time.perf_counter() - clock), steps / (time.process_time() - cpu)))
    by_clock, by_cpu = zip(*speeds, strict=True)
    return max(by_clock), max(by_cpu)


def _loop(spec: EnvironmentSpec) -> int:
    with closing(make_gymnasium(spec)) as environment:
        environment.action_space.seed(0)
        environment.reset(seed=0)
        for step in range(LOOP_STEPS):
            _, _, terminated, truncated, _ = environment.step(environment.action_space.sample())
            if terminated or truncated:
                environment.reset(seed=step)
    return LOOP_STEPS


if __name__ == "__main__":
    main(*sys.argv[1:])
