"""Episodes of the test are played once more and kept, step by step, so that a page can show them."""

from __future__ import annotations

import logging
from base64 import b64encode
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from ge_torchrl.artefacts.episodes import BEST, CHAMPION, FULL, MEDIAN, WORST, Episode, Episodes
from ge_torchrl.artefacts.memory import Artefacts
from ge_torchrl.environments.backend import Backend, LimitReachedError, Trajectory
from ge_torchrl.environments.pictures import pictures_of
from ge_torchrl.environments.plants.plant import names_plant, read_plant
from ge_torchrl.environments.spec import EnvironmentSpec
from ge_torchrl.errors import ArtefactError
from ge_torchrl.report.html.scenes import DRAWN
from ge_torchrl.run.progress import print_line
from ge_torchrl.search.conclusion import TEST, VALIDATION, Verdict
from ge_torchrl.search.problem import Problem
from ge_torchrl.trees.tree import DecisionTree

RECORD = "record"
"""The purpose that backends count these steps under."""
AFTER_SEARCH = (VALIDATION, TEST, RECORD)
"""The purposes of all steps that are no part of the search."""

# Numbers of one episode, and of all: a page of them stays below 3 MB, and a second of steps is not spent on them.
_MOST_NUMBERS, _MOST_NUMBERS_OF_ALL = 30_000, 150_000
# Another episode is played while those so far took less than this [s]: of the champion, and of other sizes.
_SECONDS, _SECONDS_OF_OTHERS = 0.3, 0.15
# To draw an episode takes a second, so a run that was shorter than this goes without [s of steps].
_SECONDS_BEFORE_PICTURES = 60

_logger = logging.getLogger(__name__)


class _Wanted(NamedTuple):
    """An episode to record: which tree plays it, and what the test said of it."""

    name: str
    tree: DecisionTree
    rank: str
    episode: int
    total: float


def record_episodes(problem: Problem, verdict: Verdict) -> Episodes:
    """Play the champion's best, median and worst test episode again, and the median one of the best tree of each size.

    As many as the limits leave room for: those of the champion first. Whatever fails is told in one line, since a run
    is no worse for want of a picture.

    Args:
        problem: What was searched.
        verdict: What the search ended with.
    """
    recorded: list[Episode] = []
    try:
        for episode in _played(problem, verdict):
            recorded.append(episode)  # noqa: PERF402 - what was played before a failure is kept.
    except (LimitReachedError, KeyboardInterrupt):
        pass
    except Exception as error:  # noqa: BLE001 - the run has its verdict, and ends well without this.
        _logger.warning("No more episodes could be recorded: %s", " ".join(str(error).split()))
    seconds = step_seconds(problem.backend.spec)
    return Episodes(verdict.test_returns, _visits(verdict), tuple(recorded), seconds)


def step_seconds(spec: EnvironmentSpec) -> float | None:
    """Return how long a step of an environment is [s], which a plant with a derivative tells; None where none does.

    Args:
        spec: The environment; a wrapper may take several steps at a time.
    """
    if spec.names.wrappers or not names_plant(spec.id):
        return None
    return read_plant(spec.id, spec.names.kwargs).dt or None


def keep_episodes(artefacts: Artefacts, problem: Problem, verdict: Verdict) -> None:
    """Record episodes and leave them with what the run leaves; a failure is told in one line.

    Raises:
        ArtefactError: The disk is full: what follows could not be written either, and the run can go on later.
    """
    try:
        artefacts.write_episodes(record_episodes(problem, verdict))
    except ArtefactError:
        raise
    except Exception as error:  # noqa: BLE001 - as above.
        _logger.warning("The episodes could not be written: %s", " ".join(str(error).split()))


def write_page_of_run(path: Path, console: Console) -> None:
    """Write the page of a finished run; a failure is told in one line."""
    try:
        from ge_torchrl.report.html.writing import write_run_page

        write_run_page(path)
    except Exception as error:  # noqa: BLE001 - as above.
        told = " ".join(f"{type(error).__name__}: {error}".split())
        print_line(console, f"no page was written, and the run is complete without it ({told})")


def _played(problem: Problem, verdict: Verdict) -> Iterator[Episode]:
    backend, seeds = problem.backend, problem.judging_seeds(problem.config)
    room, speed = _MOST_NUMBERS_OF_ALL, problem.config.evaluation.steps_per_second or backend.steps_per_second
    longest = backend.spec.max_episode_steps
    for wanted in _wanted(verdict):
        seconds = _SECONDS if wanted.name == CHAMPION else _SECONDS_OF_OTHERS
        if room <= 0 or backend.ledger.steps_left < longest or backend.steps[RECORD] > seconds * speed:
            return
        seed = int(seeds[wanted.episode])
        trajectory = backend.record(wanted.tree, seed)
        episode = _kept(wanted, seed, trajectory, min(room, _MOST_NUMBERS))
        if (wanted.name, wanted.rank) == (CHAMPION, MEDIAN):
            episode = replace(episode, pictures=_pictures(backend, trajectory, seed, speed))
        room -= episode.observations.size
        yield episode


def _pictures(
    backend: Backend, trajectory: Trajectory, seed: int, speed: float
) -> tuple[tuple[int, str], ...]:
    """Return pictures of an episode that no page can draw by itself; none where that fails, or would cost too much."""
    is_worth_it = backend.name == "gymnasium" and backend.steps.total() > _SECONDS_BEFORE_PICTURES * speed
    has_room = backend.ledger.steps_left >= backend.spec.max_episode_steps
    if backend.spec.id in DRAWN or not is_worth_it or not has_room:
        return ()
    try:
        found = pictures_of(backend.spec, trajectory, seed, backend.ledger, RECORD)
    except Exception as error:  # noqa: BLE001 - many environments cannot be drawn, which is nothing to tell.
        _logger.debug("No pictures: %s", error)
        return ()
    return tuple((step, b64encode(png).decode("ascii")) for step, png in found)


def _kept(wanted: _Wanted, seed: int, trajectory: Trajectory, room: int) -> Episode:
    """Return as many steps of an episode as there is room for their observations, at least one."""
    n_steps = len(trajectory.rewards)
    kept = min(n_steps, max(1, room // trajectory.observations.shape[1] - 1))
    observations = trajectory.observations[: kept + 1]
    return Episode(
        tree=wanted.name,
        rank=wanted.rank,
        seed=seed,
        total=wanted.total,
        length=n_steps,
        terminated=trajectory.terminated,
        truncated=trajectory.truncated,
        observations=np.where(np.isfinite(observations), observations, np.float32(np.nan)),
        actions=trajectory.actions[:kept],
        rewards=trajectory.rewards[:kept].astype(np.float32),
    )


def _wanted(verdict: Verdict) -> Iterator[_Wanted]:
    champion, returns = verdict.champion.pruned, verdict.test_returns
    order = _order(returns)
    ranks = {MEDIAN: order[(len(order) - 1) // 2], WORST: order[0], BEST: order[-1]}
    for rank, episode in ranks.items():
        yield _Wanted(CHAMPION, champion, rank, int(episode), float(returns[episode]))
    for finalist, of_size in zip(verdict.by_size, verdict.test_returns_by_size, strict=True):
        tree = finalist.pruned
        if tree != champion and np.isfinite(of_size).all():
            episode = _order(of_size)[(len(of_size) - 1) // 2]
            name = str(tree.num_decision_nodes)
            yield _Wanted(name, tree, MEDIAN, int(episode), float(of_size[episode]))


def _order(returns: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the episodes from the worst to the best, of equals in their order."""
    return np.argsort(returns, kind="stable")


def _visits(verdict: Verdict) -> dict[str, NDArray[np.int64]]:
    named = {CHAMPION: verdict.champion.pruned, FULL: verdict.champion.full}
    named |= {str(one.pruned.num_decision_nodes): one.pruned for one in verdict.by_size}
    return {name: verdict.test_visits[tree] for name, tree in named.items() if tree in verdict.test_visits}
