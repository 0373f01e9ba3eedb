"""Compiled dynamics of Gymnasium's classic-control environments, many episodes side by side.

How lanes lie is told in `lanes`. The equations are those of Gymnasium 1.x, sources
`envs/classic_control/{cartpole,acrobot,mountain_car}.py`; tests hold every step to Gymnasium's within 1e-12 (law 5).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled
from ge_torchrl.environments.kernels.calling import call
from ge_torchrl.environments.kernels.continuous_dynamics import (
    advance_continuous_mountain_car,
    advance_pendulum,
    continuous_mountain_car_starts,
    pendulum_starts,
)
from ge_torchrl.environments.kernels.lanes import (
    ACTION,
    COS_1,
    COS_2,
    LANES,
    OBS_0,
    OBS_1,
    OBS_2,
    OBS_3,
    OBS_4,
    OBS_5,
    REWARD,
    SIN_1,
    SIN_2,
    STATE_0,
    STATE_1,
    STATE_2,
    STATE_3,
    TERMINATED,
    VECTOR,
    Starts,
    start_rows,
    to_float32,
    uniform_states,
)
from ge_torchrl.environments.kernels.trigonometry import round_to_integer, sin_cos, sin_cos_reduced

CARTPOLE, ACROBOT, MOUNTAIN_CAR, PENDULUM, CONTINUOUS_MOUNTAIN_CAR = 0, 1, 2, 3, 4

_POLE_FALLEN = 12 * 2 * np.pi / 360  # rad
_PI = np.pi


@compiled
def advance_cartpole(lanes: NDArray[np.float64], n: int) -> None:
    """Step `n` lanes of CartPole-v1: explicit Euler, 0.02 s, force of 10 N to the left or right."""
    for i in range(n):
        x, x_dot = lanes[STATE_0 + i], lanes[STATE_1 + i]
        theta, theta_dot = lanes[STATE_2 + i], lanes[STATE_3 + i]
        force = 10.0 if lanes[ACTION + i] == 1.0 else -10.0
        # A standing pole leans less than pi / 4: no range reduction is needed.
        sine, cosine = sin_cos_reduced(theta)
        push = (force + 0.05 * (theta_dot * theta_dot) * sine) / 1.1
        theta_acceleration = (9.8 * sine - cosine * push) / (
            0.5 * (4.0 / 3.0 - 0.1 * (cosine * cosine) / 1.1)
        )
        x_acceleration = push - 0.05 * theta_acceleration * cosine / 1.1
        x = x + 0.02 * x_dot
        x_dot = x_dot + 0.02 * x_acceleration
        theta = theta + 0.02 * theta_dot
        theta_dot = theta_dot + 0.02 * theta_acceleration
        lanes[STATE_0 + i], lanes[STATE_1 + i] = x, x_dot
        lanes[STATE_2 + i], lanes[STATE_3 + i] = theta, theta_dot
        lanes[OBS_0 + i], lanes[OBS_1 + i] = to_float32(x), to_float32(x_dot)
        lanes[OBS_2 + i], lanes[OBS_3 + i] = to_float32(theta), to_float32(theta_dot)
        fallen = (x < -2.4) | (x > 2.4) | (theta < -_POLE_FALLEN) | (theta > _POLE_FALLEN)
        lanes[REWARD + i] = 1.0
        lanes[TERMINATED + i] = 1.0 if fallen else 0.0


@compiled
def advance_mountain_car(lanes: NDArray[np.float64], n: int) -> None:
    """Step `n` lanes of MountainCar-v0; actions 0, 1, 2 push left, not, right."""
    for i in range(n):
        position, velocity = lanes[STATE_0 + i], lanes[STATE_1 + i]
        _, slope = sin_cos(3.0 * position)
        velocity = velocity + ((lanes[ACTION + i] - 1.0) * 0.001 + slope * -0.0025)
        velocity = min(max(velocity, -0.07), 0.07)
        position = position + velocity
        position = min(max(position, -1.2), 0.6)
        velocity = 0.0 if (position == -1.2) & (velocity < 0.0) else velocity
        lanes[STATE_0 + i], lanes[STATE_1 + i] = position, velocity
        lanes[OBS_0 + i], lanes[OBS_1 + i] = to_float32(position), to_float32(velocity)
        lanes[REWARD + i] = -1.0
        lanes[TERMINATED + i] = 1.0 if (position >= 0.5) & (velocity >= 0.0) else 0.0


@compiled
def _acrobot_accelerations(
    sin_1: float, cos_2: float, sin_2: float, sin_12: float, omega_1: float, omega_2: float, torque: float
) -> tuple[float, float]:
    """Return both angular accelerations (Sutton and Barto's "book" equations) with a single division.

    With unit masses and lengths, centres of mass at 0.5, unit inertia: d1 = 3.5 + cos t2, d2 = 1.25 + cos t2 / 2,
    and cos(t - pi/2) = sin t.
    """
    d_1 = 3.5 + cos_2
    d_2 = 1.25 + 0.5 * cos_2
    phi_2 = 4.9 * sin_12
    phi_1 = -0.5 * (omega_2 * omega_2) * sin_2 - omega_2 * omega_1 * sin_2 + 14.7 * sin_1 + phi_2
    determinant = 1.25 * d_1 - d_2 * d_2
    inverse = 1.0 / (d_1 * determinant)
    torque_2 = torque - 0.5 * (omega_1 * omega_1) * sin_2 - phi_2
    acceleration_2 = (d_1 * torque_2 + d_2 * phi_1) * (d_1 * inverse)
    acceleration_1 = -(d_2 * acceleration_2 + phi_1) * (determinant * inverse)
    return acceleration_1, acceleration_2


@compiled
def _wrap_angle(theta: float) -> float:
    """Bring an angle back to [-pi, pi], as Gymnasium does by adding or subtracting full turns."""
    # Only a step from the very fastest states turns a link further than this.
    far_turns = round_to_integer(theta / (2.0 * _PI)) if abs(theta) > 3.0 * _PI else 0.0
    theta = theta - far_turns * (2.0 * _PI)
    theta = theta - 2.0 * _PI if theta > _PI else theta
    return theta + 2.0 * _PI if theta < -_PI else theta


@compiled
def advance_acrobot(lanes: NDArray[np.float64], n: int) -> None:
    """Step `n` lanes of Acrobot-v1: one Runge-Kutta step of fourth order over 0.2 s; torques -1, 0, 1 Nm."""
    for i in range(n):
        theta_1, theta_2 = lanes[STATE_0 + i], lanes[STATE_1 + i]
        omega_1, omega_2 = lanes[STATE_2 + i], lanes[STATE_3 + i]
        torque = lanes[ACTION + i] - 1.0
        # The first stage reuses the sines and cosines of the last observation.
        c_1, s_1, c_2, s_2 = lanes[COS_1 + i], lanes[SIN_1 + i], lanes[COS_2 + i], lanes[SIN_2 + i]
        a_1, a_2 = _acrobot_accelerations(s_1, c_2, s_2, s_1 * c_2 + c_1 * s_2, omega_1, omega_2, torque)
        v_1, v_2 = omega_1 + 0.1 * a_1, omega_2 + 0.1 * a_2
        s_1, c_1 = sin_cos(theta_1 + 0.1 * omega_1)
        s_2, c_2 = sin_cos(theta_2 + 0.1 * omega_2)
        b_1, b_2 = _acrobot_accelerations(s_1, c_2, s_2, s_1 * c_2 + c_1 * s_2, v_1, v_2, torque)
        w_1, w_2 = omega_1 + 0.1 * b_1, omega_2 + 0.1 * b_2
        s_1, c_1 = sin_cos(theta_1 + 0.1 * v_1)
        s_2, c_2 = sin_cos(theta_2 + 0.1 * v_2)
        e_1, e_2 = _acrobot_accelerations(s_1, c_2, s_2, s_1 * c_2 + c_1 * s_2, w_1, w_2, torque)
        u_1, u_2 = omega_1 + 0.2 * e_1, omega_2 + 0.2 * e_2
        s_1, c_1 = sin_cos(theta_1 + 0.2 * w_1)
        s_2, c_2 = sin_cos(theta_2 + 0.2 * w_2)
        f_1, f_2 = _acrobot_accelerations(s_1, c_2, s_2, s_1 * c_2 + c_1 * s_2, u_1, u_2, torque)
        sixth = 0.2 / 6.0
        theta_1 = _wrap_angle(theta_1 + sixth * (omega_1 + 2.0 * v_1 + 2.0 * w_1 + u_1))
        theta_2 = _wrap_angle(theta_2 + sixth * (omega_2 + 2.0 * v_2 + 2.0 * w_2 + u_2))
        omega_1 = min(max(omega_1 + sixth * (a_1 + 2.0 * b_1 + 2.0 * e_1 + f_1), -4.0 * _PI), 4.0 * _PI)
        omega_2 = min(max(omega_2 + sixth * (a_2 + 2.0 * b_2 + 2.0 * e_2 + f_2), -9.0 * _PI), 9.0 * _PI)
        s_1, c_1 = sin_cos(theta_1)
        s_2, c_2 = sin_cos(theta_2)
        lanes[STATE_0 + i], lanes[STATE_1 + i] = theta_1, theta_2
        lanes[STATE_2 + i], lanes[STATE_3 + i] = omega_1, omega_2
        lanes[COS_1 + i], lanes[SIN_1 + i], lanes[COS_2 + i], lanes[SIN_2 + i] = c_1, s_1, c_2, s_2
        lanes[OBS_0 + i], lanes[OBS_1 + i] = to_float32(c_1), to_float32(s_1)
        lanes[OBS_2 + i], lanes[OBS_3 + i] = to_float32(c_2), to_float32(s_2)
        lanes[OBS_4 + i], lanes[OBS_5 + i] = to_float32(omega_1), to_float32(omega_2)
        # -cos t1 - cos(t1 + t2) is the height of the free end above the pivot.
        swung_up = -c_1 - (c_1 * c_2 - s_1 * s_2) > 1.0
        lanes[REWARD + i] = 0.0 if swung_up else -1.0
        lanes[TERMINATED + i] = 1.0 if swung_up else 0.0


@compiled
def advance(dynamics: int, lanes: NDArray[np.float64], n: int) -> None:
    """Step the first `n` lanes by one step of the environment `dynamics`, taking each lane's action.

    Reads the rows STATE to SIN_2 and ACTION; writes these and OBSERVATION, REWARD and TERMINATED.

    Args:
        dynamics: CARTPOLE or another of these numbers; any other is the address of a user's own; see `calling`.
        lanes: [LANE_ROWS * LANES] float64.
        n: Number of lanes in use; up to VECTOR - 1 spare ones are stepped too.
    """
    padded = (n + VECTOR - 1) // VECTOR * VECTOR
    if dynamics == CARTPOLE:
        advance_cartpole(lanes, padded)
    elif dynamics == ACROBOT:
        advance_acrobot(lanes, padded)
    elif dynamics == MOUNTAIN_CAR:
        advance_mountain_car(lanes, padded)
    elif dynamics == PENDULUM:
        advance_pendulum(lanes, padded)
    elif dynamics == CONTINUOUS_MOUNTAIN_CAR:
        advance_continuous_mountain_car(lanes, padded)
    else:
        call(dynamics, lanes, padded)


def cartpole_starts(seeds: NDArray[np.int64]) -> Starts:
    """[E, START_ROWS] of CartPole-v1: every state variable uniform in [-0.05, 0.05]."""
    states = uniform_states(-0.05, 0.05, seeds, 4)
    return start_rows(states, states.astype(np.float32))


def mountain_car_starts(seeds: NDArray[np.int64]) -> Starts:
    """[E, START_ROWS] of MountainCar-v0: position uniform in [-0.6, -0.4] m, at rest."""
    states = np.zeros((len(seeds), 2))
    states[:, :1] = uniform_states(-0.6, -0.4, seeds, 1)
    return start_rows(states, states.astype(np.float32))


def acrobot_starts(seeds: NDArray[np.int64]) -> Starts:
    """[E, START_ROWS] of Acrobot-v1: angles and angular velocities uniform in [-0.1, 0.1], rounded to float32."""
    states = uniform_states(-0.1, 0.1, seeds, 4).astype(np.float32)
    theta_1, theta_2 = states[:, 0], states[:, 1]
    # Gymnasium's first observation takes the cosine of a float32; NumPy's float32 cosine gives the same bits.
    first = np.stack([np.cos(theta_1), np.sin(theta_1), np.cos(theta_2), np.sin(theta_2)], axis=1)
    starts = start_rows(states.astype(np.float64), np.concatenate([first, states[:, 2:]], axis=1))
    exact = np.stack(
        [np.cos(starts[:, 0]), np.sin(starts[:, 0]), np.cos(starts[:, 1]), np.sin(starts[:, 1])], 1
    )
    starts[:, COS_1 // LANES : SIN_2 // LANES + 1] = exact
    return starts


@dataclass(frozen=True)
class Dynamics:
    """Compiled dynamics of one environment.

    Attributes:
        index: Which branch of `advance` steps it, or the address of what does.
        starts: Episode seeds [E] to start rows [E, S], bit for bit Gymnasium's `reset(seed=s)`.
    """

    index: int
    starts: Callable[[NDArray[np.int64]], Starts]


DYNAMICS = {
    "CartPole-v1": Dynamics(CARTPOLE, cartpole_starts),
    "Acrobot-v1": Dynamics(ACROBOT, acrobot_starts),
    "MountainCar-v0": Dynamics(MOUNTAIN_CAR, mountain_car_starts),
    "Pendulum-v1": Dynamics(PENDULUM, pendulum_starts),
    "MountainCarContinuous-v0": Dynamics(CONTINUOUS_MOUNTAIN_CAR, continuous_mountain_car_starts),
}
