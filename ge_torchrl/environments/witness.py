"""What is seen of an environment that it had not said of itself, and the warnings of it."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.environments.spec import EnvironmentSpec

_logger = logging.getLogger(__name__)

_LARGEST = float(np.finfo(np.float32).max)


class Witness:
    """What was seen of an environment that it had not said of itself.

    Attributes:
        checks: (feature, low, high) of each feature; a value outside is told to `note`. Changed in place.
        outside: A value of each feature that was seen outside its declared bounds, or not finite.
        is_endless: Whether an episode was ended by us, because the environment sets no limit.
    """

    def __init__(self, spec: EnvironmentSpec) -> None:
        self._spec = spec
        self.outside: dict[int, float] = {}
        self.is_endless = False
        self._is_outside_reported = self._is_endless_reported = False
        # Infinity is outside any bounds: it is legal where none are declared, but nobody means it.
        bounds = zip(spec.low.tolist(), spec.high.tolist(), strict=True)
        self.checks = [(i, max(low, -_LARGEST), min(high, _LARGEST)) for i, (low, high) in enumerate(bounds)]

    @property
    def bounds(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Bounds [D], [D] that every observation so far kept: the declared ones, infinite where they proved untrue."""
        low, high = self._spec.low.copy(), self._spec.high.copy()
        features = list(self.outside)
        low[features], high[features] = -np.inf, np.inf
        return low, high

    def note(self, observation: list[float]) -> None:
        """Take note of what is outside its bounds in an observation without NaN."""
        for feature, low, high in self.checks:
            if not low <= observation[feature] <= high:
                self.outside[feature] = observation[feature]
                self.checks[feature] = (feature, -math.inf, math.inf)

    def hear(self, outside: Mapping[int, float], *, is_endless: bool) -> None:
        """Take note of what another witness saw."""
        for feature, value in outside.items():
            self.outside.setdefault(feature, value)
            self.checks[feature] = (feature, -math.inf, math.inf)
        self.is_endless |= is_endless

    def recall(self, outside: Mapping[int, float], *, is_endless: bool) -> None:
        """Take note of what this witness saw, and reported, before the run was broken off."""
        self.hear(outside, is_endless=is_endless)
        self._is_outside_reported |= bool(outside)
        self._is_endless_reported |= is_endless

    def report(self) -> None:
        """Warn of what was seen, of each kind of thing once."""
        spec = self._spec
        if self.outside and not self._is_outside_reported:
            self._is_outside_reported = True
            seen = ", ".join(
                f"{spec.names.features[i]} = {value:g} (declared: {spec.low[i]:g} to {spec.high[i]:g})"
                for i, value in sorted(self.outside.items())
            )
            _logger.warning(
                "%s observes what is outside its declared bounds or not finite: %s. "
                "Trees are not simplified by these bounds.",
                spec.id,
                seen,
            )
        if self.is_endless and not self._is_endless_reported:
            self._is_endless_reported = True
            _logger.warning(
                "%s sets no episode limit and did not end: its episodes are truncated after %d steps "
                "(env.max_episode_steps sets another limit).",
                spec.id,
                spec.max_episode_steps,
            )
