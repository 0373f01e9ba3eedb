"""The kernel backend: one tree gives one answer (law 4), on any number of threads (law 6), and its ledger is true."""

from dataclasses import replace

import numpy as np
import pytest
from continuous_trees import values_of
from hypothesis import given
from hypothesis import strategies as st
from strategies import observations, trees, value_trees, weighted_trees
from trees_of_all_kinds import DISCRETE, PUBLISHED, all_kinds

from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.kernels import decisions
from ge_torchrl.environments.kernels.dynamics import DYNAMICS
from ge_torchrl.environments.kernels.lanes import ACTION, LANE_ROWS, LANES, OBSERVATION
from ge_torchrl.environments.kernels.recording import record_steps
from ge_torchrl.environments.kernels.rollouts import SELECT_MIN_EPISODES, run_forest
from ge_torchrl.environments.spec import describe
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

leaf = DecisionTree.leaf
NO_BOUNDS = np.zeros((2, 0))


def lanes_of(observed):
    """The rows of lanes that observe [B, D], B at most LANES."""
    rows = np.zeros((LANE_ROWS, LANES))
    first = OBSERVATION // LANES
    rows[first : first + observed.shape[1], : len(observed)] = observed.T
    return rows.reshape(-1)


def no_visits():
    return np.zeros(0, np.int64)


def walking(forest, tree, observed):
    """Lanes that all walk one tree."""
    arrays = forest.arrays
    root = 0 if forest.num_decision_nodes[tree] else -1
    starts = arrays.split_start[tree], arrays.leaf_start[tree]
    whole = [np.full(LANES, number, np.int64) for number in (0, tree, 0, root, *starts)]
    return decisions.Lanes(lanes_of(observed), np.zeros(LANES), *whole)


def selected(forest, tree, observed):
    rows = lanes_of(observed)
    values = decisions.leaf_values(forest.arrays, tree, False)
    decisions.decide_by_selects(rows, values, forest.arrays, tree)
    return rows[ACTION : ACTION + len(observed)]


def selected_by_sums(forest, tree, observed, bounds, by_number):
    """[B, A], by selects of sums, of which leaves are evaluated before or after."""
    rows, visits = lanes_of(observed), no_visits()
    values = decisions.leaf_values(forest.arrays, tree, by_number)
    if forest.n_values == 1 and not by_number:
        decisions.evaluate_leaves(rows, values, forest.arrays, tree, bounds)
    decisions.decide_by_selects_of_sums(rows, values, forest.arrays, tree)
    if by_number:
        decisions.look_up_answers(rows, forest.arrays, tree, bounds, visits, len(observed))
    return actions_of(rows, observed, forest.n_values)


def actions_of(rows, observed, n_values):
    """[B] actions or [B, A] values of lanes."""
    first = ACTION // LANES
    values = rows.reshape(LANE_ROWS, LANES)[first : first + max(n_values, 1), : len(observed)].T
    return values if n_values else values[:, 0]


def walked(forest, tree, observed):
    lanes = walking(forest, tree, observed)
    decisions.decide_by_walks(lanes, forest.arrays, no_visits(), len(observed))
    return actions_of(lanes.rows, observed, 0)


def summed(forest, tree, observed, bounds=NO_BOUNDS):
    lanes = walking(forest, tree, observed)
    decisions.decide_by_sums(lanes, forest.arrays, bounds, no_visits(), len(observed))
    return actions_of(lanes.rows, observed, forest.n_values)


@given(st.data(), trees(), weighted_trees())
def test_selects_walks_and_sums_decide_as_numpy_does(data, tree, before):
    """Thresholds, their neighbours and infinities are among the observations."""
    observed = data.draw(observations(tree))
    expected = tree.decide(observed)
    mixed = Forest.stack([before, tree])
    np.testing.assert_array_equal(selected(mixed, 1, observed), expected)
    np.testing.assert_array_equal(summed(mixed, 1, observed), expected)
    aligned = Forest.stack([leaf(0), tree])
    np.testing.assert_array_equal(walked(aligned, 1, observed), expected)


@given(st.data(), weighted_trees(), weighted_trees())
def test_sums_decide_as_numpy_does_for_any_weights(data, tree, before):
    observed = data.draw(observations(tree))
    forest = Forest.stack([before, tree])
    expected = tree.decide(observed)
    np.testing.assert_array_equal(summed(forest, 1, observed), expected)
    for by_number in (False, True):
        decided = selected_by_sums(forest, 1, observed, NO_BOUNDS, by_number)
        np.testing.assert_array_equal(decided, expected)


@given(st.data(), st.integers(1, 3))
def test_values_are_numpys_within_their_bounds(data, n_values):
    """Summed in float64 in the order of the terms, rounded to float32, then clipped, in every way to decide."""
    before, tree = (data.draw(value_trees(n_values=n_values)) for _ in range(2))
    observed = np.nan_to_num(data.draw(observations(tree)))
    ends = data.draw(st.lists(st.tuples(*[st.floats(width=32, allow_nan=False)] * 2), min_size=3, max_size=3))
    bounds = np.sort(ends[:n_values], axis=1).T.astype(float)
    forest = Forest.stack([before, tree])
    expected = np.clip(tree.decide(observed), *bounds.astype(np.float32))
    np.testing.assert_array_equal(summed(forest, 1, observed, bounds), expected)
    for by_number in (True,) if n_values > 1 else (False, True):
        decided = selected_by_sums(forest, 1, observed, bounds, by_number)
        np.testing.assert_array_equal(decided, expected)


@pytest.mark.parametrize("environment_id", DYNAMICS)
@pytest.mark.parametrize("n_episodes", [3, SELECT_MIN_EPISODES + 7])
def test_every_step_of_every_kind_of_tree_is_the_trees_own(environment_id, n_episodes, opened):
    """An episode in a crowd is the recorded one, each action of which is what NumPy decides."""
    backend = opened(environment_id)
    kinds = all_kinds(environment_id)
    seeds = np.arange(40, 40 + n_episodes)
    outcomes = backend.evaluate(Forest.stack(kinds), seeds, "fitness", visits=True)
    visits = []
    for p, tree in enumerate(kinds):
        counted = np.zeros(tree.num_leaves, np.int64)
        for e, seed in enumerate(seeds):
            played = backend.record(tree, int(seed))
            seen, is_force = played.observations[:-1], backend.spec.is_continuous
            expected = values_of(backend.spec, tree, seen) if is_force else tree.decide(seen)
            np.testing.assert_array_equal(played.actions, expected)
            assert played.actions.dtype == (np.float32 if is_force else np.int64)
            assert sum(played.rewards.tolist()) == outcomes.returns[p, e]
            assert len(played.rewards) == outcomes.lengths[p, e]
            assert played.terminated or played.truncated
            counted += np.bincount(tree.leaf_of(played.observations[:-1]), minlength=tree.num_leaves)
        visits.append(counted)
    np.testing.assert_array_equal(outcomes.leaf_visits, np.concatenate(visits))
    assert backend.steps == {"fitness": outcomes.env_steps, "record": outcomes.env_steps}


@pytest.mark.parametrize("environment_id", DYNAMICS)
@pytest.mark.parametrize("n_episodes", [3, SELECT_MIN_EPISODES + 7, 150])
def test_an_episode_depends_on_its_tree_and_seed_alone(environment_id, n_episodes, opened):
    """Selects and walks, one to three threads, alone and in a crowd, counting and not: the same bits."""
    kinds = all_kinds(environment_id)
    seeds = np.arange(100, 100 + n_episodes)
    single = opened(environment_id)
    crowd = single.evaluate(Forest.stack(kinds), seeds, "fitness", visits=True)
    assert crowd.leaf_visits.sum() == crowd.env_steps
    for threads in (1, 2, 3):
        threaded = opened(environment_id, threads)
        for visits in (False, True):
            again = threaded.evaluate(Forest.stack(kinds), seeds, "fitness", visits=visits)
            np.testing.assert_array_equal(again.returns, crowd.returns)
            np.testing.assert_array_equal(again.lengths, crowd.lengths)
            np.testing.assert_array_equal(again.leaf_visits, crowd.leaf_visits if visits else None)
        for p, tree in enumerate(kinds):
            alone = threaded.evaluate(Forest.stack([tree]), seeds, "fitness")
            np.testing.assert_array_equal(alone.returns[0], crowd.returns[p])
            np.testing.assert_array_equal(alone.lengths[0], crowd.lengths[p])
    for e in (0, n_episodes - 1):
        lonely = single.evaluate(Forest.stack(kinds), seeds[e : e + 1], "fitness")
        np.testing.assert_array_equal(lonely.returns[:, 0], crowd.returns[:, e])


@pytest.mark.parametrize("environment_id", DISCRETE)
def test_published_trees_have_their_published_means(environment_id, opened):
    tree, mean = PUBLISHED[environment_id]
    outcomes = opened(environment_id, 2).evaluate(Forest.stack([tree]), np.arange(1000), "test")
    exact = environment_id == "MountainCar-v0"
    assert outcomes.returns.mean() == pytest.approx(mean, rel=1e-12 if exact else 2e-3)


@pytest.mark.parametrize("environment_id", DYNAMICS)
def test_what_trees_observe_is_what_they_act_on_in_training_episodes(environment_id, opened):
    kinds = all_kinds(environment_id)

    def observed(threads, trees, rngs):
        backend = opened(environment_id, threads)
        seen = backend.observe(trees, 700, rngs, "neighbours")
        assert backend.steps == {"neighbours": 700 * len(trees)}
        return seen

    def generators():
        return [np.random.default_rng(r) for r in range(len(kinds))]

    together = observed(3, kinds, generators())
    n_features = describe(environment_id).n_features
    assert (together.shape, together.dtype) == ((len(kinds), 700, n_features), np.float32)
    np.testing.assert_array_equal(observed(1, kinds, generators()), together)
    np.testing.assert_array_equal(observed(2, kinds[2:3], generators()[2:3])[0], together[2])


def test_no_tree_no_episode_and_no_step_are_no_trouble(opened):
    backend = opened("CartPole-v1", 2)
    gap = Forest.concatenate([Forest.stack([leaf(0)]), without_tree(), Forest.stack([leaf(1)])])
    for seeds in (np.arange(30), np.arange(2)):
        outcomes = backend.evaluate(gap, seeds, "fitness", visits=True)
        assert np.isnan(outcomes.returns[1]).all()
        assert (outcomes.lengths[1] == 0).all()
        assert (outcomes.returns[[0, 2]] > 0).all()
        assert (outcomes.leaf_visits > 0).all()
    assert backend.evaluate(Forest.stack([]), np.arange(3), "fitness").returns.shape == (0, 3)
    assert backend.evaluate(gap, np.arange(0), "fitness").returns.shape == (3, 0)
    assert backend.observe([], 5, [], "fitness").shape == (0, 5, 4)
    assert backend.observe([leaf(0)], 0, [np.random.default_rng(0)], "fitness").shape == (1, 0, 4)


def without_tree():
    nothing = Forest.stack([]).arrays
    one = np.zeros(2, np.int64)
    return Forest(nothing._replace(split_start=one, leaf_start=one))


def test_an_episode_limit_of_the_user_truncates(opened):
    backend = opened("MountainCar-v0", max_episode_steps=37)
    outcomes = backend.evaluate(Forest.stack([leaf(1)]), np.arange(5), "test")
    assert (outcomes.returns == -37).all()
    assert backend.record(leaf(1), 0).truncated


@pytest.mark.parametrize("environment_id", DYNAMICS)
def test_speed_is_measured_once_and_is_not_in_the_ledger(environment_id, opened):
    backend = opened(environment_id, 2)
    assert backend.steps_per_second > 1e5
    assert backend.steps_per_second == backend.steps_per_second
    assert backend.steps.total() == 0


def test_an_environment_that_is_made_otherwise_has_no_kernel(opened):
    spec = describe("CartPole-v1")
    others = (
        replace(spec, id="Unheard-v0"),
        replace(spec, names=replace(spec.names, kwargs={"sutton_barto_reward": True})),
        replace(spec, names=replace(spec.names, wrappers=("gymnasium.wrappers:RescaleObservation",))),
    )
    for other in others:
        with pytest.raises(EnvironmentFaultError, match=r"env\.route=kernel needs a kernel"):
            KernelBackend(other)
    assert opened("CartPole-v1", max_episode_steps=7).spec.max_episode_steps == 7


def test_trees_whose_answers_are_no_actions_here_are_refused(opened):
    force, values = opened("Pendulum-v1"), DecisionTree.value_leaf
    for backend, tree, said in (
        (force, leaf(0), "Pendulum-v1 takes 1 values a leaf; these trees hold actions"),
        (force, values([0.0, 1.0]), "these trees hold 2 values a leaf"),
        (opened("CartPole-v1"), values([0.0]), "CartPole-v1 takes actions; these trees hold 1 values a leaf"),
    ):
        with pytest.raises(ValueError, match=said):
            backend.evaluate(Forest.stack([tree]), np.arange(2), "test")
        with pytest.raises(ValueError, match=said):
            backend.record(tree, 0)
        with pytest.raises(ValueError, match=said):
            backend.observe([tree], 3, [np.random.default_rng(0)], "test")


def test_trees_with_actions_and_with_values_run_in_one_compilation(opened):
    opened("CartPole-v1").evaluate(Forest.stack([leaf(0)]), np.arange(2), "test")
    opened("CartPole-v1").record(leaf(0), 0)
    known = run_forest.signatures, record_steps.signatures
    for tree in all_kinds("Pendulum-v1"):
        opened("Pendulum-v1").evaluate(Forest.stack([tree]).take([0]), np.arange(2), "test")
        opened("Pendulum-v1").record(tree, 0)
    assert (run_forest.signatures, record_steps.signatures) == known
