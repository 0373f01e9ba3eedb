"""What is said about a command line: other packages' errors in one line, and names and texts as they are shown."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from ge_torchrl.cli.choices import choices
from ge_torchrl.config import check_choice
from ge_torchrl.errors import ConfigError

_LONGEST_NAME = 160


def one_line(error: BaseException) -> str:
    """Return what an error and its cause say, in one line."""
    texts = [str(error), str(error.__cause__ or "")]
    return " ".join(" ".join(texts).split())


def unknown_choice(group: str, choice: str, offered: Iterable[str]) -> ConfigError:
    """Return the error for a choice that a group does not offer.

    Args:
        group: The group of files, such as `env`.
        choice: What was asked for.
        offered: What is offered beside conf/.

    Raises:
        ConfigError: The choice is one of an earlier version, and now goes by another name.
    """
    check_choice(group, choice)
    others = (option for option in offered if not option.startswith("_"))
    expected = ", ".join(sorted({*choices(group), *others}))
    return ConfigError(f"{group}={choice} is unknown; expected one of {expected}; got {choice}")


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
