"""The jobs of a command line: one, or as many as the values of a sweep combine to."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Any

from ge_torchrl.errors import ConfigError

_MOST = 10_000


def jobs_of(overrides: Sequence[Any]) -> Iterable[tuple[str, ...]]:
    """Return the overrides of every job: all combinations of the values that are swept over.

    Args:
        overrides: Hydra's.

    Raises:
        ConfigError: There is no job, since a key has no value to take, or there are more than anybody waits for.
    """
    values = [_values(override) for override in overrides]
    if (n_jobs := math.prod(map(len, values))) > _MOST:
        raise ConfigError(f"a sweep must have at most {_MOST} jobs, because all are checked first; got more")
    if n_jobs == 0:
        empty = next(override for override, of in zip(overrides, values, strict=True) if not of)
        raise ConfigError(
            f"{empty.key_or_group} must have a value for each job of a sweep; got {empty.input_line}, which has none"
        )
    return itertools.product(*values)


def _values(override: Any) -> list[str]:
    if not override.is_sweep_override():
        return [str(override.input_line)]
    swept = itertools.islice(override.sweep_string_iterator(), _MOST + 1)
    return [f"{override.get_key_element()}={value}" for value in swept]
