"""A state taken apart and put together is the state, to the byte (law 8)."""

from dataclasses import replace

import numpy as np
import pytest
from generations_for_tests import everything, run
from hypothesis import given
from hypothesis import strategies as st
from problems_for_tests import FEATURES, GOOD, POOR, POORER, contender, member
from states_for_tests import told_apart
from strategies import trees, value_trees, weighted_trees

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.search.archive import Archive
from ge_torchrl.search.climbing import Climber, Climbers
from ge_torchrl.search.population import Population
from ge_torchrl.search.saving import Packed, pack, unpack
from ge_torchrl.search.state import Counts, SearchState
from ge_torchrl.trees.controller import Names
from ge_torchrl.trees.forest import Forest

NAMES = Names("CartPole-v1", FEATURES, ("",) * 4, ("left", "right"))
SEEN = np.arange(12, dtype=np.float32).reshape(3, 4)


def there_and_back(state, names=NAMES):
    return unpack(pack(state), names)


def state_of(found, *, seen=SEEN):
    """Return a state with these trees in all places where there are trees, and nothing at its default."""
    one, two = found[0], found[-1]
    archive = Archive((replace(member(one), confirmed_on=7), member(two)), frozenset([b"a" * 16, b"b" * 16]))
    forest = Forest.stack(found)
    codons = np.arange(len(found) * 3, dtype=np.int32).reshape(-1, 3)
    climber = Climber(two, seen, unbeaten=3)
    return SearchState(
        generation=4,
        population=Population(codons, forest, np.array([-np.inf, *range(1, len(found))])),
        archive=archive,
        set_aside=(Archive(), Archive((member(one, float("-inf")),), frozenset([b"c" * 16]))),
        times_refined={one.structure: 2, b"": 1},
        best_refined=contender(two, 0.1, "polish"),
        climbers=Climbers(climber, Climber(one, seen[:0]), patience=80, lost=2),
        counts=Counts(1, 2, 3, 4, 5, 6),
    )


def test_states_of_a_search_in_which_everything_goes_on(opened):
    for state, _ in run(everything(opened), 7):
        assert told_apart(there_and_back(state)) == told_apart(state)
    assert state.archive.members
    assert state.times_refined


@given(st.one_of(*(st.lists(kind, min_size=1, max_size=4) for kind in (trees(4, 2), weighted_trees(4, 2)))))
def test_trees_of_actions(found):
    state = state_of(found)
    assert told_apart(there_and_back(state)) == told_apart(state)


@given(st.lists(value_trees(4, 2), min_size=1, max_size=4))
def test_trees_of_values(found):
    names = Names("Force-v0", FEATURES, ("",) * 4, ("x", "y"), action_bounds=((-1, 1), (-2, 2)))
    state = state_of(found)
    assert told_apart(there_and_back(state, names)) == told_apart(state)


def test_a_population_without_any_tree(opened):
    (state, _), *_ = run(everything(opened, ge={"genotype_length": 2, "generations": 2}), 1)
    assert not state.population.forest.valid.any()
    assert told_apart(there_and_back(state)) == told_apart(state)


class TestRefused:
    """A file may say anything; kernels must not read beyond their arrays."""

    @staticmethod
    def altered(name, change):
        packed = pack(state_of([GOOD, POOR, POORER]))
        array = packed.arrays[name].copy()
        change(array)
        return Packed(packed.plain, {**packed.arrays, name: array})

    @pytest.mark.parametrize("forest", ["population", "trees"])
    @pytest.mark.parametrize("name", ["feature", "children_left", "children_right", "action"])
    @pytest.mark.parametrize("value", [99, -99])
    def test_numbers_that_no_tree_has(self, forest, name, value):
        def change(array):
            array[0] = value

        with pytest.raises(InvalidTreeError):
            unpack(self.altered(f"{forest}.{name}", change), NAMES)

    @pytest.mark.parametrize("name", ["split_start", "leaf_start", "term_start"])
    def test_trees_that_begin_nowhere(self, name):
        def change(array):
            array[1] = 50

        with pytest.raises((InvalidTreeError, IndexError, ValueError)):
            unpack(self.altered(f"population.{name}", change), NAMES)

    def test_codons_that_are_none(self):
        def change(array):
            array[0, 0] = -1

        with pytest.raises(ValueError, match="codons"):
            unpack(self.altered("codons", change), NAMES)

    def test_what_is_missing(self):
        packed = pack(state_of([GOOD, POOR]))
        for name in packed.arrays:
            arrays = {key: array for key, array in packed.arrays.items() if key != name}
            with pytest.raises(KeyError):
                unpack(Packed(packed.plain, arrays), NAMES)
        for name in packed.plain:
            plain = {key: value for key, value in packed.plain.items() if key != name}
            with pytest.raises(KeyError):
                unpack(Packed(plain, packed.arrays), NAMES)
