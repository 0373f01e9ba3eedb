"""The commands beside running: each reads its arguments, calls one room, and prints what comes back."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from ge_torchrl.cli.evaluating import evaluate
from ge_torchrl.cli.reporting import report

VERBS: Mapping[str, Callable[[list[str]], int]] = MappingProxyType({"evaluate": evaluate, "report": report})
"""By the first word of the command line; each takes the others and returns the exit status."""
