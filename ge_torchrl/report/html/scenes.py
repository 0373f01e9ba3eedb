"""Environments that a page draws from what is observed, as `assets/scenes.js` does; others are shown by pictures."""

DRAWN = frozenset(
    {
        "Acrobot-v1",
        "CartPole-v0",
        "CartPole-v1",
        "LunarLander-v2",
        "LunarLander-v3",
        "LunarLanderContinuous-v2",
        "LunarLanderContinuous-v3",
        "MountainCar-v0",
        "MountainCarContinuous-v0",
        "Pendulum-v1",
    }
)
