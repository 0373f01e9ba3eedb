"""Law 5, episode by episode: all routes tell one truth, whatever the threads, processes and neighbours."""

import sys

import gymnasium as gym
import numpy as np
import pytest
from environments_for_tests import CountdownEnv
from strategies import observed_trees

from ge_torchrl.environments.compiled_route import CompiledRoute
from ge_torchrl.environments.dynamics import DYNAMICS
from ge_torchrl.environments.gymnasium_route import GymnasiumRoute
from ge_torchrl.environments.rollouts import SELECT_MIN_EPISODES
from ge_torchrl.environments.spec import describe
from ge_torchrl.seeding import episode_seeds
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest

TREES = 300
# Unstable physics multiplies a last-bit difference of sine and cosine by thousands within an episode.
LEAST_EQUAL = {"MountainCar-v0": 1.0, "CartPole-v1": 0.99, "Acrobot-v1": 0.95}

leaf, split = DecisionTree.leaf, DecisionTree.split
PUBLISHED = {
    "CartPole-v1": (split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1)), 499.968),
    "Acrobot-v1": (
        split(5, -14.2778, leaf(0), split(4, -2.9144, leaf(1), split(5, 0.3094, leaf(0), leaf(2)))),
        -113.992,
    ),
    "MountainCar-v0": (
        split(
            1,
            -0.0005,
            split(0, -1.0361, leaf(2), leaf(0)),
            split(1, 0.0063, split(0, -0.3981, leaf(2), leaf(0)), leaf(2)),
        ),
        -107.93,
    ),
}


def plain_gymnasium(environment_id, tree, seed):
    """The oracle: one episode, as anybody would write it."""
    environment = gym.make(environment_id)
    observation, _ = environment.reset(seed=int(seed))
    total, length, ended = 0.0, 0, False
    while not ended:
        observation, reward, terminated, truncated, _ = environment.step(int(tree.decide([observation])[0]))
        total, length, ended = total + reward, length + 1, terminated or truncated
    return total, length


@pytest.mark.parametrize("environment_id", DYNAMICS)
def test_random_trees_have_the_same_episodes_on_both_routes(environment_id, capsys):
    spec = describe(environment_id)
    forest = Forest.stack(observed_trees(environment_id, TREES, seed=1))
    seeds = np.array([11])
    compiled, gymnasium = CompiledRoute(spec), GymnasiumRoute(spec, workers=1)
    ours, theirs = compiled.evaluate(forest, seeds), gymnasium.evaluate(forest, seeds)
    compiled.close()
    gymnasium.close()
    equal = (ours.returns == theirs.returns) & (ours.lengths == theirs.lengths)
    with capsys.disabled():
        print(
            f"\n{environment_id}: {equal.mean():.2%} of {equal.size} episodes equal, "
            f"mean return {ours.returns.mean():.3f} compiled, {theirs.returns.mean():.3f} Gymnasium",
            end=" ",
        )
    assert equal.mean() >= LEAST_EQUAL[environment_id]
    assert abs(ours.returns.mean() - theirs.returns.mean()) <= 0.01 * abs(theirs.returns.mean())
    # Trees that all act alike would make equality cheap.
    assert len(np.unique(theirs.returns)) > 10


@pytest.mark.parametrize("environment_id", DYNAMICS)
def test_long_episodes_of_a_good_tree_are_nearly_all_equal(environment_id, capsys):
    spec = describe(environment_id)
    forest = Forest.stack([PUBLISHED[environment_id][0]])
    compiled, gymnasium = CompiledRoute(spec), GymnasiumRoute(spec, workers=1)
    ours, theirs = compiled.evaluate(forest, np.arange(100)), gymnasium.evaluate(forest, np.arange(100))
    compiled.close()
    gymnasium.close()
    equal = ours.returns == theirs.returns
    with capsys.disabled():
        print(f"\n{environment_id}, published tree: {equal.mean():.0%} of 100 episodes equal", end=" ")
    assert equal.mean() >= LEAST_EQUAL[environment_id]
    # The few episodes that part ways are other draws from the same distribution.
    standard_error = theirs.returns.std() / np.sqrt(theirs.returns.size)
    assert abs(ours.returns.mean() - theirs.returns.mean()) <= 2 * standard_error


@pytest.mark.parametrize("environment_id", DYNAMICS)
def test_the_gymnasium_route_is_a_plain_gymnasium_loop(environment_id):
    spec = describe(environment_id)
    trees = observed_trees(environment_id, 3, seed=2)
    route = GymnasiumRoute(spec, workers=1)
    outcomes = route.evaluate(Forest.stack(trees), np.arange(7))
    route.close()
    for p, tree in enumerate(trees):
        for e in range(7):
            assert (outcomes.returns[p, e], outcomes.lengths[p, e]) == plain_gymnasium(
                environment_id, tree, e
            )


@pytest.mark.parametrize("environment_id", DYNAMICS)
def test_published_trees_have_their_published_means(environment_id):
    tree, mean = PUBLISHED[environment_id]
    route = CompiledRoute(describe(environment_id))
    outcomes = route.evaluate(Forest.stack([tree]), np.arange(1000))
    route.close()
    exact = environment_id == "MountainCar-v0"
    assert outcomes.returns.mean() == pytest.approx(mean, rel=1e-12 if exact else 2e-3)


@pytest.mark.parametrize("environment_id", DYNAMICS)
@pytest.mark.parametrize("n_episodes", [3, SELECT_MIN_EPISODES + 7, 150])
def test_an_episode_depends_on_its_tree_and_seed_alone(environment_id, n_episodes):
    """Selects and walks, one thread and three, alone and in a crowd: the same bits."""
    spec = describe(environment_id)
    trees = observed_trees(environment_id, 9, seed=3)
    seeds = np.arange(100, 100 + n_episodes)
    single, threaded = CompiledRoute(spec, threads=1), CompiledRoute(spec, threads=3)
    crowd = single.evaluate(Forest.stack(trees), seeds)
    np.testing.assert_array_equal(threaded.evaluate(Forest.stack(trees), seeds).returns, crowd.returns)
    for p, tree in enumerate(trees):
        alone = threaded.evaluate(Forest.stack([tree]), seeds)
        np.testing.assert_array_equal(alone.returns[0], crowd.returns[p])
        np.testing.assert_array_equal(alone.lengths[0], crowd.lengths[p])
    for e in (0, n_episodes - 1):
        lonely = single.evaluate(Forest.stack(trees), seeds[e : e + 1])
        np.testing.assert_array_equal(lonely.returns[:, 0], crowd.returns[:, e])
    single.close()
    threaded.close()


def test_worker_processes_change_nothing():
    spec = describe("CartPole-v1")
    forest = Forest.stack(observed_trees("CartPole-v1", 4, seed=4))
    alone, workers = GymnasiumRoute(spec, workers=1), GymnasiumRoute(spec, workers=2)
    expected = alone.evaluate(forest, np.arange(6))
    outcomes = workers.evaluate(forest, np.arange(6))
    alone.close()
    workers.close()
    np.testing.assert_array_equal(outcomes.returns, expected.returns)
    np.testing.assert_array_equal(outcomes.lengths, expected.lengths)


@pytest.fixture
def countdown():
    gym.register("Countdown-v0", entry_point=CountdownEnv)
    yield
    del gym.registry["Countdown-v0"]


@pytest.mark.usefixtures("countdown")
def test_worker_processes_know_what_this_program_registered():
    route = GymnasiumRoute(describe("Countdown-v0"), workers=2)
    outcomes = route.evaluate(Forest.stack([leaf(0), leaf(1)]), np.arange(2))
    route.close()
    assert outcomes.returns.tolist() == [[15, 15], [18, 18]]


@pytest.mark.parametrize("make_route", [CompiledRoute, lambda spec: GymnasiumRoute(spec, workers=1)])
def test_visits_count_every_node_on_the_way(make_route):
    spec = describe("CartPole-v1")
    # The pole never leans by 1 rad, so the right half is never seen.
    tree = split(2, 1.0, split(3, 0.0, leaf(0), leaf(1)), split(0, 0.0, leaf(0), leaf(1)))
    route = make_route(spec)
    visits = route.count_visits(tree, np.arange(20))
    steps = route.evaluate(Forest.stack([tree]), np.arange(20)).env_steps
    route.close()
    assert visits[0] == visits[1] == steps
    assert visits[2] + visits[3] == steps
    assert visits[2] > 0
    assert visits[3] > 0
    assert visits[4:].tolist() == [0, 0, 0]


@pytest.mark.parametrize("make_route", [CompiledRoute, lambda spec: GymnasiumRoute(spec, workers=1)])
def test_an_individual_without_a_tree_has_no_episodes(make_route):
    trees = Forest.stack([leaf(0), leaf(1)])
    gap = Forest(
        np.array([0, 1, 1, 2]),
        *(getattr(trees, n) for n in ("feature", "threshold", "children_left", "children_right", "action")),
    )
    route = make_route(describe("CartPole-v1"))
    outcomes = route.evaluate(gap, np.arange(30))
    route.close()
    assert np.isnan(outcomes.returns[1]).all()
    assert (outcomes.lengths[1] == 0).all()
    assert (outcomes.returns[[0, 2]] > 0).all()


def test_an_episode_limit_of_the_user_truncates_on_both_routes():
    spec = describe("MountainCar-v0", max_episode_steps=37)
    for route in (CompiledRoute(spec), GymnasiumRoute(spec, workers=1)):
        outcomes = route.evaluate(Forest.stack([leaf(1)]), np.arange(5))
        route.close()
        assert (outcomes.returns == -37).all()


@pytest.mark.usefixtures("countdown")
def test_first_action_of_a_shifted_action_space_is_respected():
    route = GymnasiumRoute(describe("Countdown-v0"), workers=1)
    outcomes = route.evaluate(Forest.stack([leaf(0), leaf(1)]), np.arange(2))
    route.close()
    # CountdownEnv pays the action's own number, 5 or 6, for each of its three steps.
    assert outcomes.returns.tolist() == [[15, 15], [18, 18]]


def test_lunar_lander_runs_and_a_used_environment_is_as_good_as_a_new_one():
    pytest.importorskip("Box2D")
    spec = describe("LunarLander-v3")
    tree = split(4, -0.07, leaf(1), split(3, -0.3, leaf(2), leaf(3)))
    route = GymnasiumRoute(spec, workers=1)
    crowd = route.evaluate(Forest.stack([tree]), np.arange(20))
    again = route.evaluate(Forest.stack([tree]), np.array([19, 3]))
    route.close()
    np.testing.assert_array_equal(again.returns[0], crowd.returns[0, [19, 3]])
    assert spec.solved_at == 200


@pytest.mark.parametrize("environment_id", DYNAMICS)
def test_what_a_tree_observes_is_its_episodes_step_by_step(environment_id):
    tree, _ = PUBLISHED[environment_id]
    spec = describe(environment_id)
    compiled = CompiledRoute(spec, threads=1)
    observed = compiled.observe(tree, 60, np.random.default_rng(5))
    compiled.close()
    assert (observed.shape, observed.dtype) == ((60, spec.n_features), np.float32)
    first = int(episode_seeds("training", 32, np.random.default_rng(5))[0])
    environment = gym.make(environment_id)
    observation, _ = environment.reset(seed=first)
    for ours in observed:
        np.testing.assert_allclose(ours, observation, atol=1e-5)
        observation, *_ = environment.step(int(tree.decide([observation])[0]))


@pytest.mark.parametrize("make", [CompiledRoute, GymnasiumRoute])
def test_exactly_at_a_threshold_a_tree_goes_right_when_observed_too(make):
    """Every episode of MountainCar begins at rest, where this tree pushes to the right."""
    route = make(describe("MountainCar-v0"))
    observed = route.observe(split(1, 0.0, leaf(0), leaf(2)), 3000, np.random.default_rng(3))
    route.close()
    at_rest = np.flatnonzero(observed[:-1, 1] == 0.0)
    assert len(at_rest) > 10
    pushed_right = 0.001 - 0.0025 * np.cos(3 * observed[at_rest, 0])
    np.testing.assert_allclose(observed[at_rest + 1, 1], pushed_right, atol=1e-6)


def test_gymnasium_observes_as_many_steps_as_asked_over_as_many_episodes_as_it_takes():
    route = GymnasiumRoute(describe("CartPole-v1"), workers=1)
    observed = route.observe(leaf(0), 40, np.random.default_rng(0))
    route.close()
    assert (observed.shape, observed.dtype) == ((40, 4), np.float32)
    # Always pushed to the left, the cart falls within a dozen steps, and another episode begins at rest.
    at_rest = np.abs(observed).max(axis=1) <= 0.05
    assert at_rest[0]
    assert at_rest.sum() >= 3


@pytest.mark.parametrize(
    "route",
    [
        CompiledRoute(describe("CartPole-v1"), threads=1),
        CompiledRoute(describe("CartPole-v1"), threads=2),
        GymnasiumRoute(describe("CartPole-v1"), workers=1),
    ],
    ids=["one_thread", "two_threads", "gymnasium"],
)
def test_jobs_give_their_results_in_their_order_and_their_errors(route):
    interval, seeds = sys.getswitchinterval(), np.arange(3)
    trees = [leaf(0), leaf(1), PUBLISHED["CartPole-v1"][0]]

    def job(tree):
        return lambda own: own.evaluate(Forest.stack([tree]), seeds).returns[0].tolist()

    def broken(_):
        raise ValueError("a job broke")

    together = route.run_jobs([job(tree) for tree in trees])
    assert together == [route.evaluate(Forest.stack([tree]), seeds).returns[0].tolist() for tree in trees]
    assert route.run_jobs([]) == []
    with pytest.raises(ValueError, match="a job broke"):
        route.run_jobs([job(trees[0]), broken])
    assert sys.getswitchinterval() == interval, "Python's threads take turns as they did before"
    route.close()
