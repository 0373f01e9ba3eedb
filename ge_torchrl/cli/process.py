"""The process as another package finds it."""

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager


@contextmanager
def seen_by_others(arguments: Sequence[str], variables: Mapping[str, str]) -> Iterator[None]:
    """Let others read these arguments and variables as those of the process, and leave it as it was.

    Args:
        arguments: The command line, without the program.
        variables: Values of the environment's variables by name.
    """
    argv, before = sys.argv, {name: os.environ.get(name) for name in variables}
    sys.argv = [argv[0], *arguments]
    os.environ.update(variables)
    try:
        yield
    finally:
        sys.argv = argv
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
