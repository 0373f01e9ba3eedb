"""The state of a search as plain values and arrays, and back: what a checkpoint holds of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.ge.codons import CODON_LIMIT
from ge_torchrl.search.archive import Archive, Contender, Member
from ge_torchrl.search.climbing import Climber, Climbers
from ge_torchrl.search.population import Population
from ge_torchrl.search.state import Counts, SearchState
from ge_torchrl.trees.controller import Names, check_names
from ge_torchrl.trees.forest import Forest, ForestArrays
from ge_torchrl.trees.rows import starts
from ge_torchrl.trees.tree import DecisionTree, FloatArray

# Trees that were offered to an archive are known by digests of so many bytes.
_DIGEST = 16

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Packed:
    """A state taken apart.

    Attributes:
        plain: What JSON can say; floats may be infinite.
        arrays: The rest, none of them of Python objects.
    """

    plain: dict[str, Any]
    arrays: dict[str, NDArray[Any]]


def pack(state: SearchState) -> Packed:
    """Take a state apart; `unpack` gives it back to the byte."""
    packing, population = _Packing(), state.population
    plain = {
        "generation": state.generation,
        "counts": asdict(state.counts),
        "archive": packing.archive(state.archive),
        "set_aside": [packing.archive(archive) for archive in state.set_aside],
        "best_refined": packing.record(state.best_refined),
        "climbers": {
            **_scalars(state.climbers),
            "climber": packing.record(state.climbers.climber),
            "waiting": packing.record(state.climbers.waiting),
        },
    }
    refined = state.times_refined
    arrays: dict[str, NDArray[Any]] = {
        "codons": population.codons,
        "fitness": population.fitness,
        **_named("population", population.forest),
        **_named("trees", Forest.stack(packing.trees)),
        **_joined("observed", packing.observed),
        **_joined("offered", [_bytes(b"".join(offered)) for offered in packing.offered]),
        **_joined("refined", [_bytes(structure) for structure in refined]),
        "times_refined": np.array(list(refined.values()), np.int64),
    }
    return Packed(plain, arrays)


def unpack(packed: Packed, names: Names) -> SearchState:
    """Put a state together again.

    Args:
        packed: What `pack` made of it, read from a file perhaps.
        names: Of the environment, which all trees have to fit.

    Raises:
        InvalidTreeError: A tree is none, or does not fit.
        KeyError, IndexError, TypeError, ValueError: It is not what `pack` makes.
    """
    plain, arrays = packed.plain, packed.arrays
    unpacking = _Unpacking(
        trees=_checked_trees(_forest("trees", arrays), names),
        observed=_split("observed", arrays),
        offered=_split("offered", arrays),
    )
    climbers = plain["climbers"]
    structures = (part.tobytes() for part in _split("refined", arrays))
    return SearchState(
        generation=plain["generation"],
        population=_population(arrays, names),
        archive=unpacking.archive(plain["archive"]),
        set_aside=tuple(map(unpacking.archive, plain["set_aside"])),
        times_refined=dict(zip(structures, arrays["times_refined"].tolist(), strict=True)),
        best_refined=unpacking.record(Contender, plain["best_refined"]),
        climbers=Climbers(
            **{
                **climbers,
                "climber": unpacking.record(Climber, climbers["climber"]),
                "waiting": unpacking.record(Climber, climbers["waiting"]),
            }
        ),
        counts=Counts(**plain["counts"]),
    )


@dataclass(eq=False)
class _Packing:
    """Trees, observations and digests of all records, each by its number."""

    trees: list[DecisionTree] = field(default_factory=list)
    observed: list[FloatArray] = field(default_factory=list)
    offered: list[frozenset[bytes]] = field(default_factory=list)

    def archive(self, archive: Archive) -> dict[str, Any]:
        self.offered.append(archive.offered)
        members = [self.record(member) for member in archive.members]
        return {"members": members, "offered": len(self.offered) - 1}

    def record(self, record: Contender | Member | Climber | None) -> dict[str, Any] | None:
        if record is None:
            return None
        self.trees.append(record.tree)
        plain = {**_scalars(record), "tree": len(self.trees) - 1}
        if not isinstance(record, Contender):
            self.observed.append(record.observed)
            plain["observed"] = len(self.observed) - 1
        return plain


@dataclass(frozen=True, eq=False)
class _Unpacking:
    trees: Sequence[DecisionTree]
    observed: Sequence[FloatArray]
    offered: Sequence[NDArray[np.uint8]]

    def archive(self, plain: dict[str, Any]) -> Archive:
        digests = self.offered[plain["offered"]].tobytes()
        offered = frozenset(digests[i : i + _DIGEST] for i in range(0, len(digests), _DIGEST))
        members = [self.record(Member, member) for member in plain["members"]]
        return Archive(tuple(filter(None, members)), offered)

    def record(self, kind: type[Any], plain: dict[str, Any] | None) -> Any:
        if plain is None:
            return None
        told = {**plain, "tree": self.trees[plain["tree"]]}
        if "observed" in plain:
            told["observed"] = self.observed[plain["observed"]]
        return kind(**told)


def _scalars(record: Any) -> dict[str, Any]:
    """Return the numbers and texts of a record."""
    values = {entry.name: getattr(record, entry.name) for entry in fields(record)}
    return {name: value for name, value in values.items() if isinstance(value, int | float | str)}


def _population(arrays: Arrays, names: Names) -> Population:
    codons, fitness, forest = arrays["codons"], arrays["fitness"], _forest("population", arrays)
    if (codons.ndim, codons.dtype.str, fitness.dtype.str) != (2, "<i4", "<f8"):
        raise ValueError("codons and fitness are not what they should be")
    if not len(codons) == len(fitness) == len(forest):
        raise ValueError("codons, trees and fitness differ in number")
    if codons.size > 0 and not (codons.min() >= 0 and codons.max() < CODON_LIMIT):
        raise ValueError("codons out of range")
    _checked_trees(forest, names)
    return Population(codons, forest, fitness)


def _checked_trees(forest: Forest, names: Names) -> list[DecisionTree]:
    """Return the trees of a forest, which is refused where a kernel would read beyond its arrays."""
    rows = np.flatnonzero(forest.valid)
    trees = [DecisionTree(*forest.tree(row).arrays) for row in rows.tolist()]
    for tree in trees:
        check_names(tree, names)
    read, sound = forest.arrays._asdict(), Forest.stack(trees).arrays._asdict()
    for name in ("split_start", "leaf_start"):
        lengths, expected = np.diff(read.pop(name)), np.zeros(len(forest), np.int64)
        expected[rows] = np.diff(sound.pop(name))
        if not np.array_equal(lengths, expected):
            raise InvalidTreeError("trees do not lie end to end")
    if trees and not all(np.array_equal(read[name], sound[name]) for name in read):
        raise InvalidTreeError("splits and leaves are not numbered depth first")
    return trees


def _named(name: str, forest: Forest) -> dict[str, NDArray[Any]]:
    return {f"{name}.{key}": array for key, array in forest.arrays._asdict().items()}


def _forest(name: str, arrays: Arrays) -> Forest:
    return Forest(ForestArrays(**{key: arrays[f"{name}.{key}"] for key in ForestArrays._fields}))


def _joined(name: str, parts: Sequence[NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return arrays that differ in length alone end to end, and where each begins."""
    rows = np.concatenate(parts) if parts else np.zeros(0, np.uint8)
    return {f"{name}.rows": rows, f"{name}.start": starts([len(part) for part in parts])}


def _split(name: str, arrays: Arrays) -> list[NDArray[Any]]:
    rows, start = arrays[f"{name}.rows"], arrays[f"{name}.start"].tolist()
    return [rows[first:end].copy() for first, end in pairwise(start)]


def _bytes(content: bytes) -> NDArray[np.uint8]:
    return np.frombuffer(content, np.uint8)
