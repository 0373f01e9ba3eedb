"""Recorded episodes as plain values for a page: numbers as base64 of float32, which a page reads exactly."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ge_torchrl.artefacts.episodes import BEST, MEDIAN, WORST, Episode, Episodes

_ORDER = (BEST, MEDIAN, WORST)


def episode_values(episodes: Episodes | None) -> list[dict[str, Any]]:
    """Return the recorded episodes, of each tree from the best to the worst."""
    if episodes is None:
        return []
    recorded = sorted(episodes.recorded, key=lambda one: _ORDER.index(one.rank) if one.rank in _ORDER else 3)
    return [_values(episode) for episode in recorded]


def _values(episode: Episode) -> dict[str, Any]:
    return {
        "tree": episode.tree,
        "rank": episode.rank,
        "seed": episode.seed,
        "total": episode.total,
        "length": episode.length,
        "kept": len(episode.rewards),
        "end": "terminated" if episode.terminated else "truncated" if episode.truncated else "",
        "observations": packed(episode.observations),
        "actions": packed(episode.actions),
        "rewards": packed(episode.rewards),
        "pictures": [[step, png] for step, png in episode.pictures],
    }


def packed(numbers: ArrayLike) -> str:
    """Return numbers as base64 of little-endian float32, row after row."""
    return base64.b64encode(np.asarray(numbers, "<f4").tobytes()).decode("ascii")
