"""Law 5, step by step: compiled dynamics are Gymnasium's."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ge_torchrl.environments.kernels.dynamics import DYNAMICS, advance
from ge_torchrl.environments.kernels.lanes import (
    ACTION,
    COS_1,
    LANE_ROWS,
    LANES,
    OBSERVATION,
    REWARD,
    SIN_1,
    SIN_2,
    START_ROWS,
    TERMINATED,
)
from ge_torchrl.environments.kernels.trigonometry import sin_cos

WALKS, WALK_STEPS = 40, 500


# NumPy squares a float32 torque and an angle by a power function, whose last bit is not always the nearest.
REWARD_TOLERANCE = {"Pendulum-v1": 1e-9}


def put(lanes, environment_id, state):
    """Set lane 0 to a state, with the sines and cosines that belong to it."""
    # MountainCarContinuous computes in float32, but for its first state.
    tripled = 3 * state[0]
    state = np.asarray(state, np.float64)
    lanes[: len(state), 0] = state
    if environment_id == "Acrobot-v1":
        trigonometry = [np.cos(state[0]), np.sin(state[0]), np.cos(state[1]), np.sin(state[1])]
        lanes[COS_1 // LANES : SIN_2 // LANES + 1, 0] = trigonometry
    elif environment_id == "Pendulum-v1":
        lanes[COS_1 // LANES : SIN_1 // LANES + 1, 0] = np.cos(state[0]), np.sin(state[0])
    elif environment_id == "MountainCarContinuous-v0":
        lanes[COS_1 // LANES, 0] = np.cos(np.float64(tripled))


def random_action(space, rng):
    """An action of the space, the ends of a Box often, and what lies beyond them now and then."""
    if not isinstance(space, gym.spaces.Box):
        return int(rng.integers(space.n))
    values = rng.uniform(space.low, space.high) * rng.choice([0.3, 1.0, 1.5])
    return rng.choice([values, space.low, space.high], p=[0.6, 0.2, 0.2]).astype(np.float32)


@pytest.mark.parametrize("environment_id", DYNAMICS)
def test_every_step_of_long_walks_is_gymnasiums(environment_id):
    dynamics = DYNAMICS[environment_id]
    environment = gym.make(environment_id).unwrapped
    n_features = environment.observation_space.shape[0]
    observed = slice(OBSERVATION // LANES, OBSERVATION // LANES + n_features)
    rng = np.random.default_rng(7)
    lanes = np.zeros((LANE_ROWS, LANES))
    terminations = 0
    for walk in range(WALKS):
        environment.reset(seed=walk)
        # Persistent actions drive the walk far from rest; random ones keep it near.
        persistence = rng.choice([0.0, 0.8, 0.97])
        action = environment.action_space.sample() * 0
        for _ in range(WALK_STEPS):
            if rng.random() >= persistence:
                action = random_action(environment.action_space, rng)
            put(lanes, environment_id, environment.state)
            lanes[ACTION // LANES, 0] = np.float64(action).item()
            advance(dynamics.index, lanes.reshape(-1), 1)
            observation, reward, terminated, _, _ = environment.step(action)
            state = np.asarray(environment.state, np.float64)
            np.testing.assert_allclose(lanes[: len(state), 0], state, rtol=0, atol=1e-12)
            np.testing.assert_array_equal(lanes[observed, 0].astype(np.float32), observation)
            assert abs(lanes[REWARD // LANES, 0] - reward) <= REWARD_TOLERANCE.get(environment_id, 0.0)
            assert lanes[TERMINATED // LANES, 0] == terminated
            if terminated:
                terminations += 1
                break
    assert (terminations > 0) == (environment_id != "Pendulum-v1")


def test_a_pendulum_that_turns_for_long_is_gymnasiums():
    """Its angle is not wrapped: the reward brings it back to half a turn."""
    environment = gym.make("Pendulum-v1").unwrapped
    environment.reset(seed=0)
    lanes, rng = np.zeros((LANE_ROWS, LANES)), np.random.default_rng(4)
    turns = rng.integers(-200, 200, 2000) * 2 + 1
    at_the_bottom = turns * np.pi + rng.choice([0.0, 1e-15, 1e-9, 1.0], 2000) * rng.normal(size=2000)
    for theta in at_the_bottom:
        state = np.array([theta, rng.uniform(-8, 8)])
        action = random_action(environment.action_space, rng)
        put(lanes, "Pendulum-v1", state)
        lanes[ACTION // LANES, 0] = action.item()
        advance(DYNAMICS["Pendulum-v1"].index, lanes.reshape(-1), 1)
        environment.state = state
        _, reward, _, _, _ = environment.step(action)
        assert abs(lanes[REWARD // LANES, 0] - reward) <= 1e-9
        np.testing.assert_allclose(lanes[:2, 0], environment.state, rtol=0, atol=1e-12)


@pytest.mark.parametrize("environment_id", ["Pendulum-v1", "MountainCarContinuous-v0"])
def test_whole_episodes_are_gymnasiums_from_their_first_step(environment_id):
    """Their state and what belongs to it stay in the lanes: nothing is put there but the starts."""
    dynamics, n = DYNAMICS[environment_id], 40
    environment = gym.make(environment_id)
    space, rng = environment.action_space, np.random.default_rng(5)
    pushes = rng.choice([-1.0, 0.3, 1.0], (200, n)).cumsum(0) * 0.2
    actions = np.clip(pushes.astype(np.float32), space.low, space.high)
    lanes = np.zeros((LANE_ROWS, LANES))
    lanes[:START_ROWS, :n] = dynamics.starts(np.arange(n)).T
    first, steps = OBSERVATION // LANES, []
    for chosen in actions:
        lanes[ACTION // LANES, :n] = chosen
        advance(dynamics.index, lanes.reshape(-1), n)
        steps.append(lanes[[first, first + 1, REWARD // LANES, TERMINATED // LANES], :n].copy())
    ends = 0
    for episode in range(n):
        environment.reset(seed=episode)
        for t, step in enumerate(steps):
            observation, reward, terminated, _, _ = environment.step(actions[t, episode : episode + 1])
            np.testing.assert_allclose(step[:2, episode], observation[:2], rtol=0, atol=1e-6)
            assert step[2, episode] == pytest.approx(reward, abs=1e-6)
            assert step[3, episode] == terminated
            if terminated:
                ends += 1
                break
    assert (ends > 0) == (environment_id != "Pendulum-v1")


def test_acrobot_steps_like_gymnasium_from_the_fastest_states():
    environment = gym.make("Acrobot-v1").unwrapped
    environment.reset(seed=0)
    lanes = np.zeros((LANE_ROWS, LANES))
    rng = np.random.default_rng(3)
    bound = np.array([np.pi, np.pi, 4 * np.pi, 9 * np.pi])
    for _ in range(3000):
        state = rng.choice([-1, 1], 4) * bound * rng.uniform(0.8, 1.0, 4)
        action = int(rng.integers(3))
        put(lanes, "Acrobot-v1", state)
        lanes[ACTION // LANES, 0] = action
        advance(DYNAMICS["Acrobot-v1"].index, lanes.reshape(-1), 1)
        environment.state = state
        environment.step(action)
        # Fast states have accelerations of thousands of rad/s^2, so the rounding of a step grows with them.
        np.testing.assert_allclose(lanes[:4, 0], environment.state, rtol=0, atol=1e-11)


@pytest.mark.parametrize("environment_id", DYNAMICS)
def test_first_states_and_observations_are_bit_identical(environment_id):
    environment = gym.make(environment_id).unwrapped
    seeds = np.concatenate([np.arange(100), np.random.default_rng(0).integers(2**31, size=100)])
    starts = DYNAMICS[environment_id].starts(seeds)
    for seed, start in zip(seeds, starts, strict=True):
        observation, _ = environment.reset(seed=int(seed))
        state = np.asarray(environment.state, np.float64)
        np.testing.assert_array_equal(start[: len(state)], state)
        first = OBSERVATION // LANES
        np.testing.assert_array_equal(start[first : first + len(observation)], observation.astype(np.float64))


@pytest.mark.parametrize("environment_id", DYNAMICS)
def test_a_lane_does_not_see_its_neighbours(environment_id):
    dynamics = DYNAMICS[environment_id]
    starts = dynamics.starts(np.arange(LANES))
    together = np.zeros((LANE_ROWS, LANES))
    together[:START_ROWS] = starts.T
    for n in (1, 3, 8, 13, LANES):
        few = np.zeros((LANE_ROWS, LANES))
        few[:START_ROWS, :n] = starts[:n].T
        for _ in range(5):
            advance(dynamics.index, few.reshape(-1), n)
        full = together.copy()
        for _ in range(5):
            advance(dynamics.index, full.reshape(-1), LANES)
        np.testing.assert_array_equal(few[:, :n], full[:, :n])


@given(st.floats(-1e4, 1e4))
def test_sine_and_cosine_are_accurate_to_the_last_bits(x):
    sine, cosine = sin_cos(x)
    assert abs(sine - np.sin(x)) <= 2.3e-16
    assert abs(cosine - np.cos(x)) <= 2.3e-16
