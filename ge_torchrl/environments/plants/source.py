"""The source of a plant's kernel: a user's scalar functions, wrapped over lanes.

Only numbers go into the text; the user's functions are names that `kernel` binds. Lanes lie
as `lanes` tells: eight rows of state, the observation, and behind it what more of state there is.
"""

from __future__ import annotations

from collections.abc import Iterable

from ge_torchrl.environments.kernels.lanes import (
    ACTION,
    LANE_ROWS,
    LANES,
    MAX_ACTIONS,
    MAX_FEATURES,
    OBSERVATION,
    REWARD,
    TERMINATED,
)
from ge_torchrl.environments.plants.plant import Plant

_STATE_ROWS = OBSERVATION // LANES
_SIXTH, _HALF = "DT / 6.0", "DT / 2.0"


def fits_lanes(plant: Plant) -> bool:
    """Tell whether there are rows enough for a plant."""
    return (
        start_width(plant) - _STATE_ROWS <= MAX_FEATURES and len(plant.actions.bounds or "1") <= MAX_ACTIONS
    )


def start_width(plant: Plant) -> int:
    """Return how many rows a start fills, S."""
    return _STATE_ROWS + len(plant.features) + max(0, len(plant.start) - _STATE_ROWS)


def state_rows(plant: Plant) -> list[int]:
    """Return the row of each entry of the state."""
    behind = _STATE_ROWS + len(plant.features)
    return [row if row < _STATE_ROWS else behind + row - _STATE_ROWS for row in range(len(plant.start))]


def observation_rows(plant: Plant) -> list[int]:
    """Return the row of each entry of the observation."""
    return [_STATE_ROWS + row for row in range(len(plant.features))]


def kernel_source(plant: Plant) -> str:
    """Return the module; see `kernel.PlantKernel` for its functions."""
    parts = [
        f'"""The kernel of {plant.dynamics.rpartition(":")[2]}, made by ge_torchrl.environments.plants.source."""',
        "import numba\nimport numpy as np",
        *_integrated(plant),
        _observing(plant),
        _stepping(plant),
        _beginning(plant),
        *(_over_lanes(plant) if fits_lanes(plant) else ()),
    ]
    return "\n\n\n".join(parts) + "\n"


def _integrated(plant: Plant) -> Iterable[str]:
    """Return a `STEP` made of a derivative."""
    if "derivative" not in plant.functions:
        return
    n = len(plant.start)

    def ahead(slope: str, time: str) -> str:
        return _tuple(f"s[{i}] + {time} * {slope}[{i}]" for i in range(n))

    lines = ["k1 = DERIVATIVE(s, action)"]
    if plant.integrator == "euler":
        lines.append(f"after = {ahead('k1', 'DT')}")
    else:
        lines += [
            f"k2 = DERIVATIVE({ahead('k1', _HALF)}, action)",
            f"k3 = DERIVATIVE({ahead('k2', _HALF)}, action)",
            f"k4 = DERIVATIVE({ahead('k3', 'DT')}, action)",
            "after = "
            + _tuple(
                f"s[{i}] + {_SIXTH} * (k1[{i}] + 2.0 * k2[{i}] + 2.0 * k3[{i}] + k4[{i}])" for i in range(n)
            ),
        ]
    ended = "TERMINATED(after)" if "terminated" in plant.functions else "False"
    yield _function("STEP", "s, action", [*lines, f"return after, REWARD(after, action), {ended}"])


def _observing(plant: Plant) -> str:
    observe = "OBSERVE(state)" if "observe" in plant.functions else "state"
    entries = _tuple(f"np.float64(np.float32(o[{i}]))" for i in range(len(plant.features)))
    return _function("observation", "state", [f"o = {observe}", f"return {entries}"])


def _stepping(plant: Plant) -> str:
    n, n_features = len(plant.start), len(plant.features)
    zeros = [f"0.0 * after[{i}]" for i in range(n)] + [f"0.0 * seen[{i}]" for i in range(n_features)]
    return _function(
        "step",
        "state, action",
        [
            "s, paid, ended = STEP(state, action)",
            f"after = {_tuple(f'float(s[{i}])' for i in range(n))}",
            "seen, reward = observation(after), float(paid)",
            # Zero times what is infinite or no number is no number.
            f"is_finite = {' + '.join(zeros)} + 0.0 * reward == 0.0",
            "return after, seen, reward, bool(ended), is_finite",
        ],
    )


def _beginning(plant: Plant) -> str:
    rows = state_rows(plant)
    lines = ["for e in range(len(states)):"]
    lines.append(f"    state = {_tuple(f'states[e, {i}]' for i in range(len(rows)))}")
    lines.append("    seen = observation(state)")
    lines += [f"    starts[e, {row}] = state[{i}]" for i, row in enumerate(rows)]
    lines += [f"    starts[e, {row}] = seen[{i}]" for i, row in enumerate(observation_rows(plant))]
    return _function("begin", "states, starts", lines)


def _over_lanes(plant: Plant) -> Iterable[str]:
    rows = state_rows(plant)
    stored = [f"    lanes[{row * LANES} + i] = after[{i}]" for i, row in enumerate(rows)]
    stored += [f"    lanes[{row * LANES} + i] = seen[{i}]" for i, row in enumerate(observation_rows(plant))]
    yield _function(
        "advance",
        "lanes, n",
        [
            # What a step that raises leaves behind.
            "for i in range(n):",
            f"    lanes[{REWARD} + i], lanes[{TERMINATED} + i] = np.nan, 1.0",
            "for i in range(n):",
            f"    state = {_tuple(f'lanes[{row * LANES} + i]' for row in rows)}",
            *_action(plant),
            "    after, seen, reward, ended, is_finite = step(state, action)",
            *stored,
            f"    lanes[{REWARD} + i] = reward if is_finite else np.nan",
            f"    lanes[{TERMINATED} + i] = 1.0 if ended | (not is_finite) else 0.0",
        ],
    )
    called = [
        f"lanes = numba.carray(pointer, ({LANE_ROWS * LANES},))",
        "try:",
        "    advance(lanes, n)",
        "except Exception:",
        f"    lanes[{REWARD}] = lanes[{REWARD}]",
    ]
    yield _function("entry", "pointer, n", called, decorator="ENTERED")


def _action(plant: Plant) -> list[str]:
    """Return the lines that read a lane's action as the user's functions take it."""
    actions = plant.actions
    if actions.bounds:
        entries = [f"lanes[{ACTION + i * LANES} + i]" for i in range(len(actions.bounds))]
        return [f"    action = {entries[0] if len(entries) == 1 else _tuple(entries)}"]
    number = f"lanes[{ACTION} + i]"
    if not actions.values:
        return [f"    action = np.int64({number})"]
    # Selects, which have no branch.
    lines = [f"    action = {actions.values[0]!r}"]
    return lines + [
        f"    action = {value!r} if {number} == {float(i)!r} else action"
        for i, value in enumerate(actions.values[1:], start=1)
    ]


def _tuple(entries: Iterable[str]) -> str:
    return f"({', '.join(entries)},)"


def _function(name: str, arguments: str, lines: Iterable[str], decorator: str = "COMPILED") -> str:
    body = "\n".join(f"    {line}" for line in lines)
    return f"@{decorator}\ndef {name}({arguments}):\n{body}"
