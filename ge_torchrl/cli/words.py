"""What is said about a command line: other packages' errors in one line, and names and texts as they are shown."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ge_torchrl.checks import nearest
from ge_torchrl.config.files import choices
from ge_torchrl.errors import ConfigError

_LONGEST_NAME = 160
_EXPECTED = "expected key=value, such as seed=3"
_COMMANDS = "ge-torchrl help lists commands and keys"
# Of a Gymnasium environment.
_ID = re.compile(r"(?:[\w.]+:)?(?:[\w-]+/)?[\w.-]+-v\d+")
_SWAPPED = re.compile(r"Cannot merge (?:Dict|List)Config with (?:Dict|List)Config")


def one_line(error: BaseException) -> str:
    """Return what an error and its cause say, in one line."""
    texts = [_unmergeable(error)] if _unmergeable(error) else [str(error), str(error.__cause__ or "")]
    return " ".join(" ".join(texts).split())


def unreadable(word: str) -> str:
    """Return what to say of a word of a command line that is no key=value, or whose value cannot be read."""
    key, equals, value = word.partition("=")
    if not equals:
        meant = _meant(word)
        told = f"; type {meant}" if meant else f"; {_COMMANDS}" * word.isalpha()
        return f"{'expected key=value' if meant else _EXPECTED}; got {word!r}{told}"
    if not key.strip():
        return f"{_EXPECTED}; got {word!r}"
    front = f"the value of {key} cannot be read"
    if key.lstrip("+") == "env.wrappers":
        form = """env.wrappers='["gymnasium.wrappers:DiscretizeAction {bins: 7}"]'"""
        return (
            f"{front}, because a wrapper with arguments needs quotes of its own, as in {form}; got {value!r}"
        )
    return f"""{front}; expected it in quotes, as in {key}='"a b"'; got {value!r}"""


def _meant(word: str) -> str:
    """Return the override that a word alone may stand for; empty where none comes to mind."""
    if word.endswith(".py"):
        return f"env.dynamics={word}:Class, with the name of the class"
    if ".py:" in word:
        return f"env.dynamics={word}"
    if _ID.fullmatch(word):
        return f"env.id={word}"
    return "".join(f"env={choice}" for choice in nearest(word, choices("env")))


def _unmergeable(error: BaseException) -> str:
    """Return what to say of a list where keys with values belong, or of these where a list does; else nothing."""
    override = str(error).removeprefix("Error merging override ")
    if override == str(error) or not _SWAPPED.search(str(error.__cause__)):
        return ""
    # OmegaConf tells of both with the same words.
    told = f"expected a list where one belongs, and keys with values where these do; got {override}"
    if not override.lstrip("+").startswith("env.symmetry"):
        return told
    return f"{told}; type pairs as keys with values, as in env.symmetry='{{negate: [x], actions: {{left: right}}}}'"


@contextmanager
def folder_told(key: str) -> Iterator[None]:
    """Tell of the folder that `key` names where it cannot be made; what a run writes is told by the run itself."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise ConfigError(
            f"{key} must be a folder that can be made, because a run leaves its files there; "
            f"got {error.filename} ({error.strerror})"
        ) from error


def shortened(name: str) -> str:
    """Cut the name of a job's folder; its number keeps it apart from others, and config.yaml tells the rest."""
    return name if len(name) <= _LONGEST_NAME else f"{name[:_LONGEST_NAME]}..."


def represented(dumper: Any, text: str) -> Any:
    """Show a text of several lines, such as a grammar, as a block of lines; `dumper` is one of PyYAML's."""
    if "\n" in text:
        return dumper.represent_scalar("tag:yaml.org,2002:str", text, style="|")
    return dumper.str_representer(dumper, text)
