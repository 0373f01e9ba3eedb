import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ge_torchrl.seeding import EPISODE_SEEDS, episode_seeds, stream

SEEDS = st.integers(0, 2**64)
NAMES = st.text(max_size=20)
PURPOSES = st.sampled_from(["training", "validation", "test"])


def first_words(seed, name):
    return stream(seed, name).integers(0, 2**32, size=4).tolist()


@pytest.mark.parametrize(
    ("seed", "name", "expected"),
    [
        (0, "mutation", [3245478639, 273409107, 883780631, 1598094032]),
        (0, "selection", [2192312843, 417093024, 158748835, 932001774]),
        (2**32, "mutation", [3606042516, 2707960219, 81067225, 1433243342]),
    ],
)
def test_streams_are_the_same_on_every_machine_and_in_every_version(seed, name, expected):
    assert first_words(seed, name) == expected


@given(SEEDS, NAMES)
def test_same_seed_and_name_give_the_same_stream(seed, name):
    assert first_words(seed, name) == first_words(seed, name)


@given(SEEDS, NAMES, SEEDS, NAMES)
def test_different_seeds_or_names_give_different_streams(seed, name, other_seed, other_name):
    same = (seed, name) == (other_seed, other_name)
    assert (first_words(seed, name) == first_words(other_seed, other_name)) == same


def test_a_stream_does_not_depend_on_which_others_were_drawn_from():
    alone = first_words(7, "mutation")
    stream(7, "selection").random(1000)
    assert first_words(7, "mutation") == alone


def test_streams_of_neighbouring_seeds_are_uncorrelated():
    draws = np.stack([stream(seed, "mutation").random(2000) for seed in range(8)])
    correlations = np.corrcoef(draws) - np.eye(8)
    assert np.abs(correlations).max() < 0.1


def test_negative_seed_is_refused():
    with pytest.raises(ValueError, match="non-negative"):
        stream(-1, "mutation")


def test_ranges_of_the_purposes_are_disjoint_and_valid_for_gymnasium():
    ranges = sorted(EPISODE_SEEDS.values(), key=lambda seeds: seeds.start)
    assert len(ranges) == 3
    assert ranges[0].start > 10**6, "seeds typed by hand belong to no purpose"
    assert all(before.stop <= after.start for before, after in itertools.pairwise(ranges))
    assert ranges[-1].stop <= 2**31


@given(PURPOSES, st.integers(0, 200), SEEDS)
def test_episode_seeds_lie_in_their_range_without_repetition(purpose, n, seed):
    drawn = episode_seeds(purpose, n, stream(seed, "episodes"))
    assert drawn.dtype == np.int64
    assert drawn.shape == (n,)
    assert len(set(drawn.tolist())) == n
    assert all(value in EPISODE_SEEDS[purpose] for value in drawn.tolist())


def test_episode_seeds_are_golden():
    assert episode_seeds("training", 3, stream(0, "episodes")).tolist() == [568743560, 944801880, 752882264]


def test_episode_seeds_go_on_with_the_stream():
    rng = stream(0, "episodes")
    assert episode_seeds("test", 5, rng).tolist() != episode_seeds("test", 5, rng).tolist()
