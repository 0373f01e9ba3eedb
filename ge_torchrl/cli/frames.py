"""Where in the user's own code something was raised."""

from __future__ import annotations

import os
import re
import site
import sysconfig
import traceback
from pathlib import Path

from ge_torchrl.errors import EnvironmentFaultError

_FRAME = re.compile(r'^ *File "(.+)", line (\d+), in (.+)$', re.MULTILINE)
_PACKAGE = Path(__file__).resolve().parents[1]
_MOST = 3


def told_of_frames(error: BaseException) -> str:
    """Return where in the user's own files an environment raised, to stand behind its error; empty elsewhere.

    What a worker process has told of its traceback is text, so all of it is read as text.

    Args:
        error: What is to be told.
    """
    cause = error
    while cause.__cause__ is not None:
        cause = cause.__cause__
    if cause is error or not isinstance(error, EnvironmentFaultError):
        return ""
    found = _FRAME.findall("".join(traceback.format_exception(cause)))
    own = dict.fromkeys(
        f"{_shown(name)}:{line} in {function}" for name, line, function in found if _is_own(name)
    )
    return f"; raised at {', called at '.join(list(own)[: -_MOST - 1 : -1])}" if own else ""


def _is_own(name: str) -> bool:
    """Tell whether a file is neither of this package, nor of an installed one, nor of Python."""
    path = Path(name)
    return path.is_absolute() and not any(path.is_relative_to(folder) for folder in _others())


def _others() -> list[Path]:
    names = [
        *site.getsitepackages(),
        site.getusersitepackages(),
        *map(sysconfig.get_path, ("stdlib", "platstdlib")),
    ]
    return [_PACKAGE, *(Path(name) for name in names)]


def _shown(name: str) -> str:
    here = Path.cwd()
    return os.path.relpath(name, here) if Path(name).is_relative_to(here) else name
