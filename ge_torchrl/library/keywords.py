"""Arguments by name that a call does not take, told with what may be meant."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from ge_torchrl.checks import did_you_mean
from ge_torchrl.config import similar_keys
from ge_torchrl.errors import ConfigError

_P = ParamSpec("_P")
_R = TypeVar("_R")


def keywords_told(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Return a function that refuses unknown keywords in the words of this package.

    Args:
        function: What is called; where it takes `settings`, a keyword may be the end of a key of these.
    """
    known = list(inspect.signature(function).parameters)

    @functools.wraps(function)
    def told(*arguments: _P.args, **keywords: _P.kwargs) -> _R:
        for name, value in keywords.items():
            if name not in known:
                raise ConfigError(
                    f"{name} is no argument of {function.__name__}, which takes {', '.join(known)}; "
                    f"got {name}={value!r}{_meant(name, value, known)}"
                )
        return function(*arguments, **keywords)

    return told


def _meant(name: str, value: object, known: list[str]) -> str:
    if meant := did_you_mean(name, known):
        return meant
    keys = similar_keys(name) if "settings" in known else []
    return f"; did you mean settings={{{keys[0]!r}: {value!r}}}?" if keys else ""
