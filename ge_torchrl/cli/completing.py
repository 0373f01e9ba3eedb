"""`completion`: TAB in a shell. A script asks the program for the words that may stand at the cursor.

What is asked at every TAB loads no Hydra, no Gymnasium and nothing larger.
"""

import contextlib
import io
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType

from ge_torchrl.cli.parser import Parser
from ge_torchrl.cli.statuses import OK
from ge_torchrl.config.explained import all_keys
from ge_torchrl.config.files import choices, default_choices, environment_ids

_FLAGS_OF_RUNS = (
    "--cfg=job",
    "--config-dir=",
    "--config-name=",
    "--config-path=",
    "--help",
    "--multirun",
    "--version",
)
_FLAG = re.compile(r"^\s+(?:-\w, )?(--[\w-]+)(?: \{([^}]*)\})?", re.MULTILINE)
Verb = Callable[[list[str]], int]

_BASH = """\
_ge_torchrl() {
    local IFS=$'\\n' line="${COMP_LINE:0:COMP_POINT}" current prefix
    local -a words
    IFS=' ' read -ra words <<< "$line"
    [[ $line == *' ' ]] && words+=('')
    COMPREPLY=($(ge-torchrl completion words "${words[@]:1}" 2> /dev/null))
    [[ ${COMPREPLY[0]-} == *[.=/] ]] && compopt -o nospace
    # Bash takes what stands before = or : for words of their own.
    current="${words[-1]}"
    prefix="${current%"${current##*[=:]}"}"
    COMPREPLY=("${COMPREPLY[@]#"$prefix"}")
}
complete -o default -F _ge_torchrl ge-torchrl
"""
_ZSH = """\
#compdef ge-torchrl
_ge_torchrl() {
    local -a found open
    found=("${(@f)$(ge-torchrl completion words "${(@)words[2,CURRENT]}" 2> /dev/null)}")
    open=(${(M)found:#*[.=/]})
    found=(${found:#*[.=/]})
    (( $#open )) && compadd -S '' -- $open
    (( $#found )) && compadd -- $found
    (( $#open + $#found )) || _files
}
compdef _ge_torchrl ge-torchrl
"""
_FISH = """\
function __ge_torchrl
    set -l before (commandline -opc)
    set -l current (commandline -ct)
    set -l found (ge-torchrl completion words $before[2..-1] "$current" 2> /dev/null)
    if test (count $found) -gt 0
        printf '%s\\n' $found
    else
        __fish_complete_path "$current"
    end
end
complete -c ge-torchrl -f -a '(__ge_torchrl)'
"""
SCRIPTS: Mapping[str, str] = MappingProxyType({"bash": _BASH, "zsh": _ZSH, "fish": _FISH})


def completion(arguments: list[str]) -> int:
    """Print the script of a shell, as `completion --help` tells; return the exit status."""
    parser = Parser(
        prog="ge-torchrl completion",
        description="Print the script that lets TAB complete commands, settings and their values. "
        'bash: eval "$(ge-torchrl completion bash)" in ~/.bashrc; zsh: the same with zsh in ~/.zshrc, below compinit; '
        "fish: ge-torchrl completion fish > ~/.config/fish/completions/ge-torchrl.fish",
    )
    parser.add_argument("shell", choices=tuple(SCRIPTS), help="the shell")
    print(SCRIPTS[parser.parse_args(arguments).shell], end="")
    return OK


def complete(words: Sequence[str], verbs: Mapping[str, Verb]) -> int:
    """Print what may stand in place of the last word, a line for each; nothing where files may.

    Args:
        words: Of the command line, without the program, up to the cursor.
        verbs: The commands by their names; each answers to --help.
    """
    *before, current = words or [""]
    for word in sorted(set(_offered(before, current, verbs))):
        if word.startswith(current):
            print(word)
    return OK


def _offered(before: Sequence[str], current: str, verbs: Mapping[str, Verb]) -> Iterator[str]:
    verb = before[0] if before and before[0] in verbs else ""
    if verb == "help":
        yield from (verbs if len(before) == 1 else ())
        return
    if not before:
        yield from verbs
    if not verb or verb == "run":
        yield from _FLAGS_OF_RUNS if current.startswith("-") else _overrides(current)
        return
    flags = _flags_of(verbs[verb])
    if values := flags.get(before[-1]):
        yield from values
    elif current.startswith("-"):
        yield from flags
    elif verb == "explain":
        yield from _keys(current, "")
    elif verb in ("check", "init"):
        yield from (f"env={choice}" for choice, _ in environment_ids())
        yield from (environment_id for _, environment_id in environment_ids())
        if len(before) > 1:
            yield from _overrides(current)
    elif verb == "tune":
        yield from _overrides(current)
    elif verb == "completion":
        yield from SCRIPTS


def _overrides(current: str) -> Iterator[str]:
    """Yield key=value and group=choice, as far as they are clear from what is typed."""
    key, equals, _ = current.partition("=")
    if not equals:
        yield from _keys(current, "=")
        yield from (f"{group}=" for group in default_choices())
        return
    if key in default_choices():
        yield from (f"{key}={choice}" for choice in choices(key))
    for name, rule in all_keys():
        if name == key:
            values = ("true", "false") if rule.kind == "flag" else rule.choices
            yield from (f"{key}={value}" for value in values)
            if rule.optional:
                yield f"{key}=null"


def _keys(current: str, end: str) -> Iterator[str]:
    """Yield keys up to their next dot, as a shell does with folders."""
    depth = current.count(".") + 1
    for key, _ in all_keys():
        parts = key.split(".")
        whole = len(parts) <= depth
        yield ".".join(parts[:depth]) + (end if whole else ".")


def _flags_of(verb: Verb) -> dict[str, list[str]]:
    """Return the flags of a command, each with the values that it may take, as its --help says."""
    told = io.StringIO()
    # One line for each flag.
    os.environ["COLUMNS"], os.environ["NO_COLOR"] = "1000", "1"
    with contextlib.redirect_stdout(told), contextlib.suppress(SystemExit):
        verb(["--help"])
    return {flag: values.split(",") if values else [] for flag, values in _FLAG.findall(told.getvalue())}
