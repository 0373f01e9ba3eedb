"""What can go wrong because of an input: typed errors whose text is meant for the user.

Every message says what was expected, why, and what came. The command line prints them without a traceback. Whatever
was quoted in a message, it is one line that a terminal shows as text and a person reads to its end.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from ge_torchrl.printing import message_of


class _ToldError(Exception):
    """An error that says what to do.

    Attributes:
        champion: The best controller by then, untested, where a call of the library broke off; else None.
        controllers: The best one of each number of decision nodes by then.
    """

    champion: Any = None
    controllers: Mapping[int, Any] = MappingProxyType({})

    def __init__(self, message: str = "") -> None:
        super().__init__(message_of(message))


class UserError(_ToldError):
    """Base of all errors that a user can mend; the command line prints the message and exits with status 2."""


class ConfigError(UserError):
    """A configuration value is missing, unknown, of the wrong type or out of its range."""


class GrammarError(UserError):
    """A grammar text breaks a rule of the notation; the message carries line and column."""


class InvalidTreeError(UserError):
    """Arrays or a file do not describe a decision tree."""


class InvalidObservationError(UserError, ValueError):
    """A controller was given something else than one observation."""


class UnencodableTreeError(UserError):
    """A tree has no genotype: the grammar cannot derive it, or the genotype is too short for it."""


class EnvironmentFaultError(UserError):
    """An environment is unknown, unsuitable, raised, returned NaN or never ended."""


class ArtefactError(UserError):
    """A file of a run is missing or unreadable."""


class RunFaultError(_ToldError):
    """A run broke off by a fault that no input explains; the message says in one line what is left of it."""
