"""Trees that act in Gymnasium's environments, and the plain loop that they are held to."""

import gymnasium as gym
import numpy as np

from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split

TREES = {
    "CartPole-v1": split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1)),
    "Acrobot-v1": split(5, -14.2778, leaf(0), split(5, 0.3094, leaf(0), leaf(2))),
    "MountainCar-v0": split(1, -0.0005, split(0, -1.0361, leaf(2), leaf(0)), leaf(2)),
    "LunarLander-v3": split(4, -0.07, leaf(1), split(3, -0.3, leaf(2), leaf(3))),
}
LEFT_OF_THE_MIDDLE = split(0, 0.0, leaf(1), leaf(0))


def plain_gymnasium(environment_id, tree, seed, first_action=0):
    """The oracle: one episode, as anybody would write it."""
    environment = gym.make(environment_id, disable_env_checker=True)
    observation, _ = environment.reset(seed=int(seed))
    total, length, ended = 0.0, 0, False
    while not ended:
        action = int(tree.decide(np.float32([observation]))[0]) + first_action
        observation, reward, terminated, truncated, _ = environment.step(action)
        total, length, ended = total + reward, length + 1, terminated or truncated
    return total, length
