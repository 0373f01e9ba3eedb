"""What a run ends with, and who may look on until then."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ge_torchrl.artefacts.memory import Artefacts
from ge_torchrl.artefacts.records import ArchiveRecord, GenerationRecord, Summary
from ge_torchrl.config import Config
from ge_torchrl.search.fitness import Seeds
from ge_torchrl.search.state import SearchState
from ge_torchrl.trees.controller import Controller, Names


@dataclass(frozen=True, eq=False)
class Finished:
    """What a run ends with.

    Attributes:
        artefacts: Where it left everything.
        summary: What it found.
        champion: The champion, pruned.
        archive: The best tree of each size.
        refiner: What refined trees, such as "PPO".
        improved: How many trees that bettered.
        once_more: What the last refinement changed; empty where there was none, or before the run went on.
    """

    artefacts: Artefacts
    summary: Summary
    champion: Controller
    archive: list[ArchiveRecord]
    refiner: str
    improved: int
    once_more: str = ""


Observer = Callable[[GenerationRecord, SearchState, Names], bool]
"""Is told of each generation, and may stop the search there."""

JudgingSeeds = Callable[[Config], Seeds]
"""Gives the episodes that judge what a run found."""
