"""Episodes of the test, step by step, and how often each leaf decided: `episodes.json`, for a page to play."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.errors import ArtefactError
from ge_torchrl.reading import json_of, read_text

FORMAT = "ge_torchrl.episodes/1"
CHAMPION, FULL = "champion", "full"
"""Names of trees in this file; the best tree of a size is named by its number of decision nodes."""
BEST, MEDIAN, WORST = "best", "median", "worst"


@dataclass(frozen=True, eq=False)
class Episode:
    """One episode of a tree.

    Attributes:
        tree: Which tree played.
        rank: "best", "median" or "worst" of the tree's test episodes.
        seed: Began it, by `reset(seed=seed)`.
        total: Its return, of all steps.
        length: Its number of steps; those that were too many to keep are counted.
        terminated: Whether the task ended it.
        truncated: Whether it reached its limit.
        observations: [T + 1, D] float32, of the first `T` steps; a number that is not finite is NaN.
        actions: [T] int64, or [T, A] float32 where an action is values.
        rewards: [T] float32.
        pictures: Few pictures of it, each with the step that it shows, as PNG in base64; mostly none.
    """

    tree: str
    rank: str
    seed: int
    total: float
    length: int
    terminated: bool
    truncated: bool
    observations: NDArray[np.float32]
    actions: NDArray[Any]
    rewards: NDArray[np.float32]
    pictures: tuple[tuple[int, str], ...] = ()


@dataclass(frozen=True, eq=False)
class Episodes:
    """What the test of a run saw.

    Attributes:
        returns: [E] float64, of the champion in each test episode.
        visits: For each tree that was tested [L] int64, how often its leaves decided in these episodes.
        recorded: Some episodes, step by step.
        step_seconds: How long a step is [s]; None where that is not known.
    """

    returns: NDArray[np.float64]
    visits: Mapping[str, NDArray[np.int64]]
    recorded: tuple[Episode, ...]
    step_seconds: float | None = None


def episodes_text(episodes: Episodes) -> str:
    """Return the text of the file: JSON with an episode a line; float32 numbers read back as they were."""
    entries = [
        f'"format": {json.dumps(FORMAT)}',
        f'"returns": {json.dumps(episodes.returns.tolist(), allow_nan=False)}',
        f'"visits": {json.dumps({name: visits.tolist() for name, visits in episodes.visits.items()})}',
    ]
    if episodes.step_seconds is not None:
        entries.append(f'"step_seconds": {json.dumps(episodes.step_seconds, allow_nan=False)}')
    recorded = ",\n".join(_line(episode) for episode in episodes.recorded)
    return "{" + ",\n".join([*entries, f'"recorded": [\n{recorded}\n]']) + "}\n"


def _line(episode: Episode) -> str:
    plain = {
        "tree": episode.tree,
        "rank": episode.rank,
        "seed": episode.seed,
        "total": episode.total,
        "length": episode.length,
        "terminated": episode.terminated,
        "truncated": episode.truncated,
        **({"pictures": episode.pictures} if episode.pictures else {}),
    }
    # Millions of digits by one format each take a tenth of the time that json takes for them.
    arrays = {name: _numbers(getattr(episode, name)) for name in ("observations", "actions", "rewards")}
    told = ", ".join(f'"{name}": {text}' for name, text in arrays.items())
    return f"{json.dumps(plain, allow_nan=False)[:-1]}, {told}}}"


def _numbers(array: NDArray[Any]) -> str:
    """Return an array as JSON, with nine digits, which tell float32 numbers apart; what is not finite is null."""
    if array.ndim == 1:
        values = array.tolist()
        text = ",".join(["%.9g"] * len(values)) % tuple(values)
        return f"[{text if np.isfinite(array).all() else text.replace('nan', 'null')}]"
    return f"[{','.join(_numbers(row) for row in array)}]"


def read_episodes(path: Path) -> Episodes:
    """Read the file.

    Raises:
        ArtefactError: It is missing or not in its format.
    """
    try:
        content = json_of(read_text(path))
        if content["format"] != FORMAT:
            raise ArtefactError(f"{path} must be in the format {FORMAT}; got {content['format']!r}")
        return Episodes(
            returns=np.array(content["returns"], np.float64),
            visits={str(name): np.array(v, np.int64) for name, v in content["visits"].items()},
            recorded=tuple(_episodes(content["recorded"])),
            step_seconds=_step_seconds(content.get("step_seconds")),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ArtefactError(f"{path} holds no episodes: {type(error).__name__}: {error}") from error


def _step_seconds(value: Any) -> float | None:
    if value is not None and not 0 < float(value) < float("inf"):
        raise ArtefactError(f"step_seconds must be a time above 0; got {value}")
    return None if value is None else float(value)


def _episodes(lines: Sequence[Mapping[str, Any]]) -> Iterator[Episode]:
    for line in lines:
        observations = np.array(line["observations"], np.float32)
        kind = np.float32 if line["actions"] and isinstance(line["actions"][0], list) else np.int64
        actions, rewards = np.array(line["actions"], kind), np.array(line["rewards"], np.float32)
        if observations.ndim != 2 or not len(observations) - 1 == len(actions) == len(rewards):
            raise ArtefactError("an episode must have one observation more than actions and rewards")
        yield Episode(
            tree=str(line["tree"]),
            rank=str(line["rank"]),
            seed=int(line["seed"]),
            total=float(line["total"]),
            length=int(line["length"]),
            terminated=bool(line["terminated"]),
            truncated=bool(line["truncated"]),
            observations=observations,
            actions=actions,
            rewards=rewards,
            pictures=tuple((int(step), str(png)) for step, png in line.get("pictures", ())),
        )
