"""What is known of some tasks besides: the best return that trees of a size can reach, the thesis' trees, the clock."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

from ge_torchrl.report.thesis.published import PUBLISHED
from ge_torchrl.trees.controller import Names

# By number of decision nodes, from one on. It was given to this project, not measured by it; docs/results.md.
_POSSIBLE: Mapping[str, tuple[float, ...]] = MappingProxyType(
    {
        "CartPole-v1": (199.2, 499.99, 500.0, 500.0),
        "Acrobot-v1": (-84.3, -79.1, -77.3, -74.8, -72.2, -71.0, -70.2, -69.7),
        "MountainCar-v0": (-119.4, -115.5, -100.3, -98.7, -98.6, -98.6, -97.9, -97.9),
    }
)
# How long a step is [s], as Gymnasium integrates it; MountainCar knows no seconds.
_STEP_SECONDS = MappingProxyType(
    {
        "CartPole-v0": 0.02,
        "CartPole-v1": 0.02,
        "Acrobot-v1": 0.2,
        "Pendulum-v1": 0.05,
        "LunarLander-v2": 0.02,
        "LunarLander-v3": 0.02,
        "LunarLanderContinuous-v2": 0.02,
        "LunarLanderContinuous-v3": 0.02,
    }
)
# A split on one feature adds so much to the metric M, of which the thesis tells.
_M_OF_A_SPLIT = 17.8


def known_of(names: Names) -> list[dict[str, Any]]:
    """Return marks to draw beside an archive: `kind` "possible" or "published", `nodes` and `mean`.

    Args:
        names: The environment; one that is made with anything besides is another task, of which nothing is known.
    """
    if names.environment != names.id:
        return []
    return [*_possible(names.id), *_published(names.id)]


def step_seconds_of(names: Names) -> float | None:
    """Return how long a step of an environment is [s]; None where that is not known, or a wrapper may take several."""
    return None if names.wrappers else _STEP_SECONDS.get(names.id)


def _possible(environment: str) -> Iterator[dict[str, Any]]:
    for nodes, mean in enumerate(_POSSIBLE.get(environment, ()), 1):
        yield {"kind": "possible", "nodes": nodes, "mean": mean}


def _published(environment: str) -> Iterator[dict[str, Any]]:
    published = PUBLISHED.get(environment)
    for run in published.runs if published else ():
        nodes = round(run.complexity_M / _M_OF_A_SPLIT)
        yield {"kind": "published", "nodes": nodes, "mean": run.test_mean, "run": f"R{run.number}"}
