"""An inverted pendulum on a cart, which a motor pushes: balance the pole, and bring the cart home."""

from math import cos, sin

from numba import njit

GRAVITY = 9.81  # m/s^2
CART, POLE = 1.0, 0.2  # kg
LENGTH = 0.5  # m, from the pivot to the middle of the pole
FRICTION = 0.1  # N s/m, between cart and track
STEP = 0.02  # s
TRACK, FALLEN = 2.0, 0.5  # m, rad


@njit
def accelerations(x_dot, theta, theta_dot, force):
    """Return those of the cart [m/s^2] and of the pole [rad/s^2]."""
    sine, cosine = sin(theta), cos(theta)
    push = (force - FRICTION * x_dot + POLE * LENGTH * theta_dot**2 * sine) / (CART + POLE)
    of_pole = (GRAVITY * sine - cosine * push) / (LENGTH * (4 / 3 - POLE * cosine**2 / (CART + POLE)))
    return push - POLE * LENGTH * of_pole * cosine / (CART + POLE), of_pole


class Cart:
    """x is the place of the cart, theta the lean of the pole, both to the right."""

    features = {"x": "m", "x_dot": "m/s", "theta": "rad", "theta_dot": "rad/s"}
    actions = {"force": (-10.0, 10.0)}  # N
    start = [(-1.0, 1.0), (-0.1, 0.1), (-0.2, 0.2), (-0.1, 0.1)]
    max_episode_steps = 500
    symmetry = {"negate": ["x", "x_dot", "theta", "theta_dot"], "negate_actions": ["force"]}

    @njit
    def step(state, force):
        x, x_dot, theta, theta_dot = state
        of_cart, of_pole = accelerations(x_dot, theta, theta_dot, force)
        # Speeds first: this half-implicit Euler step keeps the energy of a swing.
        x_dot += STEP * of_cart
        theta_dot += STEP * of_pole
        x += STEP * x_dot
        theta += STEP * theta_dot
        lost = abs(x) > TRACK or abs(theta) > FALLEN
        reward = 1.0 - (x / TRACK) ** 2 - (theta / FALLEN) ** 2 - 0.1 * (force / 10.0) ** 2
        return (x, x_dot, theta, theta_dot), reward, lost
