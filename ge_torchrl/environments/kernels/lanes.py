"""Where running episodes lie: lanes of one flat buffer, and the rows that a start fills.

A *lane* is one running episode. All lanes live in one flat float64 buffer, row after row of `LANES` values, so
that every offset is a compile-time constant and LLVM turns the loop over lanes into vector instructions. Rows:
four of state, four of sines and cosines that belong to it, the observation (rounded to float32, as Gymnasium
returns it), the action to take, and what a step gives back. An action is a number, or float32 values, one a row.
A user's own dynamics have eight rows of state; more of it stands behind the observation.
"""

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled
from ge_torchrl.environments.kernels.draws import first_uniforms

LANES = 64
# Loops run over a multiple of this many lanes: spare lanes compute nonsense that nobody reads, which costs less
# than a scalar remainder.
VECTOR = 8

STATE = 0
COS_1, SIN_1, COS_2, SIN_2 = 4 * LANES, 5 * LANES, 6 * LANES, 7 * LANES
OBSERVATION = 8 * LANES
# Rows for the observation and whatever stands behind it.
MAX_FEATURES = 24
ACTION = OBSERVATION + MAX_FEATURES * LANES
MAX_ACTIONS = 8
REWARD = ACTION + MAX_ACTIONS * LANES
TERMINATED = REWARD + LANES
LANE_ROWS = TERMINATED // LANES + 1
# An episode's start fills the rows from the state to the observation: so many of the dynamics that are ours.
START_ROWS = OBSERVATION // LANES + 6

STATE_0, STATE_1, STATE_2, STATE_3 = 0, LANES, 2 * LANES, 3 * LANES
OBS_0, OBS_1, OBS_2 = OBSERVATION, OBSERVATION + LANES, OBSERVATION + 2 * LANES
OBS_3, OBS_4, OBS_5 = OBSERVATION + 3 * LANES, OBSERVATION + 4 * LANES, OBSERVATION + 5 * LANES

Starts = NDArray[np.float64]


@compiled
def to_float32(x: float) -> float:
    """Round to float32, as an observation is."""
    return np.float64(np.float32(x))


def start_rows(states: NDArray[np.float64], observations: NDArray[np.float32]) -> Starts:
    """Return [E, START_ROWS] of first states [E, n] and first observations [E, D]."""
    starts = np.zeros((len(states), START_ROWS))
    starts[:, : states.shape[1]] = states
    first = OBSERVATION // LANES
    starts[:, first : first + observations.shape[1]] = observations
    return starts


def uniform_states(
    low: float | NDArray[np.float64], high: float | NDArray[np.float64], seeds: NDArray[np.int64], n: int
) -> NDArray[np.float64]:
    """Return [E, n], as `default_rng(seed).uniform(low, high, n)` for each seed; bounds may be [n]."""
    return low + (high - low) * first_uniforms(seeds, n)
