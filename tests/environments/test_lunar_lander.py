"""LunarLander's rewritten step is Gymnasium's, to the bit (law 5)."""

import gymnasium as gym
import numpy as np
import pytest

from ge_torchrl.environments import lean as lean_module
from ge_torchrl.environments.lean import lean

pytest.importorskip("Box2D")
from gymnasium.envs.box2d.lunar_lander import LunarLander, heuristic

from ge_torchrl.environments.lunar_lander import LunarLanderSteps


def sinking(environment, observation, _):
    """Lands mostly, and rests on its legs until the body sleeps."""
    return heuristic(environment, observation)


def random(environment, _, rng):
    """Turns, falls and crashes; a throttle beyond 1 is cut."""
    if environment.continuous:
        return rng.uniform(-1.2, 1.2, 2).astype(np.float32)
    return int(rng.integers(4))


def hovering(environment, observation, rng):
    """Leaves to a side with the engines on."""
    main, lateral = float(observation[3] < 0), float(observation[4] > 0.05) * rng.choice([-1, 0.7])
    return np.float32([main, lateral]) if environment.continuous else 2 if main else 3


@pytest.mark.parametrize("kwargs", [{}, {"gravity": -3.5}, {"continuous": True}])
@pytest.mark.parametrize("policy", [sinking, random, hovering])
def test_a_lander_does_the_same_in_every_step_of_every_episode(kwargs, policy):
    theirs, ours = LunarLander(**kwargs), LunarLanderSteps(LunarLander(**kwargs))
    rng, endings = np.random.default_rng(0), set()
    for seed in range(12):
        observation, _ = theirs.reset(seed=seed)
        np.testing.assert_array_equal(ours.reset(seed=seed)[0], observation)
        for _ in range(1000):
            action = policy(theirs, observation, rng)
            observation, reward, terminated, truncated, _ = theirs.step(action)
            own, *rest, _ = ours.step(action)
            assert (own.tobytes(), own.dtype, own.shape) == (observation.tobytes(), np.float32, (8,))
            assert rest == [reward, terminated, truncated]
            if terminated:
                endings.add(reward)
                break
    assert (100 if policy is sinking else -100) in endings


def test_only_the_very_lander_is_stepped_our_way():
    class Heavier(LunarLander):
        pass

    for same in (
        gym.make("LunarLander-v3"),
        gym.make("LunarLanderContinuous-v3"),
        gym.make("LunarLander-v3", gravity=-5.0, max_episode_steps=77),
    ):
        assert type(lean(same, 10_000).step.__self__) is LunarLanderSteps
    for other in (
        gym.make("LunarLander-v3", enable_wind=True),
        gym.make("LunarLander-v3", render_mode="rgb_array"),
        gym.wrappers.TransformReward(gym.make("LunarLander-v3"), float),
        Heavier(),
    ):
        assert type(lean(other, 10_000).step.__self__) is not LunarLanderSteps


def test_a_lander_that_steps_otherwise_is_left_to_itself(monkeypatch, caplog):
    class Biased(LunarLanderSteps):
        def step(self, action):
            observation, reward, *rest = super().step(action)
            return (observation, reward + 1e-9, *rest)

    lean_module._agrees.cache_clear()
    monkeypatch.setattr("ge_torchrl.environments.lunar_lander.LunarLanderSteps", Biased)
    assert type(lean(gym.make("LunarLander-v3"), 10).step.__self__) is LunarLander
    assert "LunarLander steps otherwise than expected" in caplog.text
    lean_module._agrees.cache_clear()
