"""Plants of all kinds as the texts of their files, each with what a step does in plain Python and NumPy."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
CART = "docs/examples/plant.py:Cart"
MOTOR = "docs/examples/motor.py:Motor"

# The least that a user's own class has.
GOOD = {
    "features": '{"x": "m", "v": "m/s"}',
    "actions": '("left", "right")',
    "start": "[(-1, 1), 0.0]",
    "max_episode_steps": "50",
    "step": "lambda state, action: (state, 1.0, False)",
}
PLANTS = '''
"""Plants of all kinds."""

import math

from numba import njit


@njit
def pushed(v, force):
    return v + 0.1 * (force - math.sin(3.0 * v))


class Names:
    """Actions are numbers from 0 on."""

    features = ("x", "v")
    actions = ("left", "none", "right")
    start = [(-1, 1), 0.0]
    max_episode_steps = 60
    solved_at = -3

    @njit
    def step(state, action):
        x, v = state
        v = pushed(v, action - 1)
        x += 0.1 * v
        return (x, v), -x * x, abs(x) > 1.2


class Values(Names):
    """Actions stand for numbers, and an integer is a reward."""

    actions = {"back": -2.5, "on": 0.5, "far": 3}

    @staticmethod
    def step(state, force):
        x, v = state
        v = pushed(v, force)
        return (x + 0.1 * v, v), 1 if x > 0.0 else 0, x > 1.5


class Box(Names):
    """One entry, of which something else is observed."""

    features = {"sine": "", "speed": "m/s", "both": ""}
    actions = {"force": (-1.3, 0.7)}

    def step(state, force):
        x, v = state
        v = pushed(v, force)
        return (x + 0.1 * v, v), -(force**2), False

    def observe(state):
        x, v = state
        return math.sin(x), v, x + 2 * v


class Two(Names):
    """Two entries of an action."""

    actions = {"along": (-1.0, 1.0), "across": (0.0, 2.0)}

    def step(state, action):
        along, across = action
        x, v = state
        return (x + 0.1 * along, v - 0.1 * across * x), along - across, v > 2.0


class Large:
    """More of a state than the lanes have rows for in front of the observation."""

    features = ("first", "last", "sum")
    actions = {"push": (-1.0, 1.0)}
    start = [(-1.0, 1.0)] * 11
    max_episode_steps = 40

    def step(state, push):
        a, b, c, d, e, f, g, h, i, j, k = state
        return (k + 0.1 * push, a, b, c, d, e, f, g, h, i, j), j - a, j > 1.08

    def observe(state):
        return state[0], state[10], state[3] + state[9]


class Rk4:
    """A pendulum with friction, by a derivative."""

    features = {"angle": "rad", "speed": "rad/s"}
    actions = {"torque": (-2.0, 2.0)}
    start = [(-2.0, 2.0), (-1.0, 1.0)]
    max_episode_steps = 80
    dt = 0.1

    def derivative(state, torque):
        angle, speed = state
        return speed, torque - math.sin(angle) - 0.1 * speed

    def reward(state, torque):
        return -state[0] ** 2 - torque**2

    def terminated(state):
        return abs(state[0]) > 2.5


class Euler(Rk4):
    """The same, stepped simply."""

    integrator = "euler"


class Lost(Names):
    """Far to the right its speed is no number, and nothing else tells of it."""

    def step(state, action):
        x, v = state
        return (x + 0.02 * (action - 0.5), math.sqrt(1.02 - x)), 1.0, False

    def observe(state):
        return state[0], 0.0


class Raises(Lost):
    """Far to the right it raises."""

    def step(state, action):
        x, v = state
        if x > 1.02:
            raise ValueError("too far")
        return (x + 0.02 * (action - 0.5), v), 1.0, False
'''

KINDS = ("Names", "Values", "Box", "Two", "Large", "Rk4", "Euler")


def write_plants(folder: Path) -> Path:
    """Write the file `plants.py` of all of them."""
    path = folder / "plants.py"
    path.write_text(PLANTS)
    return path


@cache
def _module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("plants_in_plain_python", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def in_plain_python(path: Path, name: str, state: tuple[float, ...], action: Any) -> tuple[Any, float, bool]:
    """One step of a plant as its author would make it by hand, without any of our code."""
    plant = getattr(_module(path), name)
    if hasattr(plant, "step"):
        return getattr(plant.step, "py_func", plant.step)(state, action)

    def ahead(slope: tuple[float, ...], time: float) -> tuple[float, ...]:
        return tuple(entry + time * part for entry, part in zip(state, slope, strict=True))

    dt, first = plant.dt, plant.derivative(state, action)
    if getattr(plant, "integrator", "rk4") == "euler":
        after = ahead(first, dt)
    else:
        second = plant.derivative(ahead(first, dt / 2), action)
        third = plant.derivative(ahead(second, dt / 2), action)
        fourth = plant.derivative(ahead(third, dt), action)
        slopes = zip(first, second, third, fourth, strict=True)
        after = ahead(tuple((a + 2 * b + 2 * c + d) / 6 for a, b, c, d in slopes), dt)
    return after, plant.reward(after, action), plant.terminated(after)


def text_of(values: Mapping[str, str]) -> str:
    """Return the text of a file with the class `Mine`, which has these values."""
    return "import numpy as np\nclass Mine:\n" + "".join(
        f"    {name} = {value}\n" for name, value in values.items()
    )
