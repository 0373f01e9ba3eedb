"""Law 5, step by step: compiled dynamics are Gymnasium's."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ge_torchrl.environments.dynamics import (
    ACTION,
    COS_1,
    DYNAMICS,
    LANE_ROWS,
    LANES,
    OBSERVATION,
    REWARD,
    SIN_2,
    START_ROWS,
    TERMINATED,
    advance,
)
from ge_torchrl.environments.trigonometry import sin_cos

WALKS, WALK_STEPS = 40, 500


def put(lanes, environment_id, state):
    """Set lane 0 to a state, with the sines and cosines that belong to it."""
    lanes[: len(state), 0] = state
    if environment_id == "Acrobot-v1":
        trigonometry = [np.cos(state[0]), np.sin(state[0]), np.cos(state[1]), np.sin(state[1])]
        lanes[COS_1 // LANES : SIN_2 // LANES + 1, 0] = trigonometry


@pytest.mark.parametrize("environment_id", DYNAMICS)
def test_every_step_of_long_walks_is_gymnasiums(environment_id):
    dynamics = DYNAMICS[environment_id]
    environment = gym.make(environment_id).unwrapped
    n_features, n_actions = environment.observation_space.shape[0], environment.action_space.n
    observed = slice(OBSERVATION // LANES, OBSERVATION // LANES + n_features)
    rng = np.random.default_rng(7)
    lanes = np.zeros((LANE_ROWS, LANES))
    terminations = 0
    for walk in range(WALKS):
        environment.reset(seed=walk)
        # Persistent actions drive the walk far from rest; random ones keep it near.
        persistence = rng.choice([0.0, 0.8, 0.97])
        action = 0
        for _ in range(WALK_STEPS):
            if rng.random() >= persistence:
                action = int(rng.integers(n_actions))
            put(lanes, environment_id, np.asarray(environment.state, np.float64))
            lanes[ACTION // LANES, 0] = action
            advance(dynamics.index, lanes.reshape(-1), 1)
            observation, reward, terminated, _, _ = environment.step(action)
            state = np.asarray(environment.state, np.float64)
            np.testing.assert_allclose(lanes[: len(state), 0], state, rtol=0, atol=1e-12)
            np.testing.assert_array_equal(lanes[observed, 0].astype(np.float32), observation)
            assert lanes[REWARD // LANES, 0] == reward
            assert lanes[TERMINATED // LANES, 0] == terminated
            if terminated:
                terminations += 1
                break
    assert terminations > 0


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
