"""The lean way to step an environment gives the same steps, to the bit."""

import copy
import pickle

import gymnasium as gym
import numpy as np
from environments_for_tests import WalkEnv
from hypothesis import given
from hypothesis import strategies as st

from ge_torchrl.environments.lean import lean


def test_wrappers_are_taken_off_down_to_the_first_that_changes_something():
    made = gym.make("CartPole-v1")
    step, _, limit = lean(made, 1000)
    assert step.__self__ is made.unwrapped
    assert limit == 500
    assert lean(gym.make("CartPole-v1"), 20).limit == 20
    doubled = gym.wrappers.TransformReward(gym.make("CartPole-v1"), lambda reward: 2 * reward)
    assert lean(doubled, 1000).step.__self__ is doubled


@given(
    st.integers(-3, 3),
    st.integers(1, 4),
    st.integers(-5, 8)
    | st.booleans()
    | st.floats(-5, 5)
    | st.none()
    | st.integers(-5, 8).flatmap(lambda i: st.sampled_from([np.int64(i), np.float32(i), np.array(i)])),
)
def test_a_space_contains_what_it_contained(start, n, x):
    environment = WalkEnv()
    environment.action_space = gym.spaces.Discrete(n, start=start)
    lean(environment, 10)
    quick, slow = environment.action_space, gym.spaces.Discrete(n, start=start)
    assert quick.contains(x) is slow.contains(x)
    assert quick == slow
    assert copy.deepcopy(quick) == slow
    assert copy.deepcopy(quick).contains(x) is slow.contains(x)
    assert pickle.dumps(quick)
