"""Compiled dynamics of the classic-control environments whose action is a force; see `dynamics`.

The equations are those of Gymnasium 1.x, sources `envs/classic_control/{pendulum,continuous_mountain_car}.py`, where
a number that NumPy rounds to float32 is rounded here. An action is a float32 value, clipped as the environment clips.
"""

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled
from ge_torchrl.environments.kernels.lanes import (
    ACTION,
    COS_1,
    LANES,
    OBS_0,
    OBS_1,
    OBS_2,
    REWARD,
    SIN_1,
    STATE_0,
    STATE_1,
    TERMINATED,
    Starts,
    start_rows,
    to_float32,
    uniform_states,
)
from ge_torchrl.environments.kernels.trigonometry import sin_cos

_PI = np.pi
_TURN = 2.0 * np.pi
# A full turn in two parts; the first has 33 bits, so that its product with a small integer is exact.
_TURN_HIGH = 6.2831853069365025
_TURN_LOW = _TURN - _TURN_HIGH

# What NumPy makes of Python's numbers beside a float32.
_POWER = float(np.float32(0.0015))
_MOST_SPEED = float(np.float32(0.07))
_LEFT_END, _GOAL, _RIGHT_END = (float(np.float32(place)) for place in (-1.2, 0.45, 0.6))
_TORQUE_COST = float(np.float32(0.001))


@compiled
def _normalised(theta: float) -> float:
    """Return an angle within [-pi, pi): `(theta + pi) % (2 pi) - pi`, bit for bit."""
    turned = theta + _PI
    turns = float(np.trunc(turned / _TURN))
    rest = (turned - turns * _TURN_HIGH) - turns * _TURN_LOW
    return (rest + _TURN if rest < 0.0 else rest) - _PI


@compiled
def advance_pendulum(lanes: NDArray[np.float64], n: int) -> None:
    """Step `n` lanes of Pendulum-v1; a torque of -2 to 2 Nm for 0.05 s. No episode terminates."""
    for i in range(n):
        theta, omega = lanes[STATE_0 + i], lanes[STATE_1 + i]
        torque = min(max(lanes[ACTION + i], -2.0), 2.0)
        lean = _normalised(theta)
        effort = to_float32(_TORQUE_COST * to_float32(torque * torque))
        lanes[REWARD + i] = -(lean * lean + 0.1 * (omega * omega) + effort)
        # Sine and cosine are those of the last observation.
        omega = omega + (15.0 * lanes[SIN_1 + i] + to_float32(3.0 * torque)) * 0.05
        omega = min(max(omega, -8.0), 8.0)
        theta = theta + omega * 0.05
        sine, cosine = sin_cos(theta)
        lanes[STATE_0 + i], lanes[STATE_1 + i] = theta, omega
        lanes[COS_1 + i], lanes[SIN_1 + i] = cosine, sine
        lanes[OBS_0 + i], lanes[OBS_1 + i] = to_float32(cosine), to_float32(sine)
        lanes[OBS_2 + i] = to_float32(omega)
        lanes[TERMINATED + i] = 0.0


@compiled
def advance_continuous_mountain_car(lanes: NDArray[np.float64], n: int) -> None:
    """Step `n` lanes of MountainCarContinuous-v0; a push of -1 to 1, whose square costs reward.

    Gymnasium keeps this state in float32, the first one apart, so it is rounded wherever that rounds.
    """
    for i in range(n):
        position, velocity, push = lanes[STATE_0 + i], lanes[STATE_1 + i], lanes[ACTION + i]
        # The slope's cosine belongs to the state: only the first is not one of a float32.
        slope = 0.0025 * lanes[COS_1 + i]
        within = to_float32(to_float32(push * _POWER) - to_float32(slope))
        beyond = to_float32((0.0015 if push > 0.0 else -0.0015) - slope)
        velocity = to_float32(velocity + (beyond if abs(push) > 1.0 else within))
        velocity = min(max(velocity, -_MOST_SPEED), _MOST_SPEED)
        position = to_float32(position + velocity)
        position = min(max(position, _LEFT_END), _RIGHT_END)
        velocity = 0.0 if (position == _LEFT_END) & (velocity < 0.0) else velocity
        _, cosine = sin_cos(to_float32(3.0 * position))
        lanes[STATE_0 + i], lanes[STATE_1 + i] = position, velocity
        lanes[COS_1 + i] = cosine
        lanes[OBS_0 + i], lanes[OBS_1 + i] = position, velocity
        arrived = (position >= _GOAL) & (velocity >= 0.0)
        lanes[REWARD + i] = (100.0 if arrived else 0.0) - push * push * 0.1
        lanes[TERMINATED + i] = 1.0 if arrived else 0.0


def pendulum_starts(seeds: NDArray[np.int64]) -> Starts:
    """[E, START_ROWS] of Pendulum-v1: angle uniform in [-pi, pi] rad, angular velocity in [-1, 1] rad/s."""
    high = np.array([_PI, 1.0])
    states = uniform_states(-high, high, seeds, 2)
    trigonometry = np.stack([np.cos(states[:, 0]), np.sin(states[:, 0])], axis=1)
    observations = np.concatenate([trigonometry, states[:, 1:]], axis=1).astype(np.float32)
    starts = start_rows(states, observations)
    starts[:, COS_1 // LANES : SIN_1 // LANES + 1] = trigonometry
    return starts


def continuous_mountain_car_starts(seeds: NDArray[np.int64]) -> Starts:
    """[E, START_ROWS] of MountainCarContinuous-v0: position uniform in [-0.6, -0.4] m, at rest."""
    states = np.zeros((len(seeds), 2))
    states[:, :1] = uniform_states(-0.6, -0.4, seeds, 1)
    starts = start_rows(states, states.astype(np.float32))
    starts[:, COS_1 // LANES] = np.cos(3.0 * states[:, 0])
    return starts
