"""Bad configurations: values, words of a command line, and files of settings."""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from command_line_for_tests import check_composes
from hostile_verdicts import PASSED, Case

from ge_torchrl.config import Config
from ge_torchrl.config.composing import compose
from ge_torchrl.config.explained import all_keys
from ge_torchrl.run.plan import plan

_HUGE, _DIGITS = 10**400, 10**5000
_VALUES: dict[str, Any] = {
    "a text": "abc",
    "an empty text": "",
    "a long text": "a" * 100_000,
    "escape codes": "\x1b[31mred",
    "a list": [1, None],
    "a list of lists": [[1]],
    "keys with values": {"a": 1},
    "NaN": float("nan"),
    "infinite": float("inf"),
    "1e300": 1e300,
    "10 ** 400": _HUGE,
    "10 ** 5000": _DIGITS,
    "below 0": -1,
    "true": True,
    "a complex number": 1 + 2j,
    "bytes": b"\xff",
    "???": "???",
}
_TEXTS = ("env.id", "grammar.bnf", "grammar.name")
_SIGNED = ("env.solved_at", "env.lowest_return")
_TOGETHER: tuple[dict[str, Any], ...] = (
    {"ge.population_size": 2_000_000_000},
    {"ge.population_size": 2_000_000_000, "ge.genotype_length": 1},
    {"ge.genotype_length": 2_000_000_000, "ge.population_size": 2},
    {"ge.wraps": 10**9},
    {"ge.restarts": 10**6, "ge.generations": 10},
    {"ge.tournament_size": 10**9},
    {"evaluation.episodes": 10**6, "ge.population_size": 10**6},
    {"archive.migrants": 10**9},
    {"archive.neighbours": 10**12},
    {"archive.neighbours_drawn": 10**6, "evaluation.episodes": 10**6},
    {"archive.final_factor": 10**9},
    {"archive.revisit_factor": 10**6, "polish.episodes": 10**6},
    {"refiner.ppo.update_timesteps": 10**9, "refiner.ppo.max_timesteps": 10**10},
    {"refiner.ppo.critic_hidden": [10**6, 10**6]},
    {"refiner.ppo.trees_together": 10**6, "refiner.ppo.critic_hidden": [1000, 1000]},
    {"refiner.ppo.update_timesteps": 100, "refiner.ppo.max_timesteps": 50},
    {"refiner.ppo.leaf_logit": 1e300},
    {"refiner.ppo.leaf_scale": 1e300},
    {"env.max_episode_steps": 1e300},
    {"env.id": "CartPole-v1", "env.dynamics": "plant.py:Cart"},
    {"env.features": ["a", "a", "b", "c"]},
    {"env.features": ["a\nb"]},
    {"env.units": ["\x1b[31m", "", "", ""]},
    {"seed": 2**64},
)
_WORDS: tuple[tuple[str, ...], ...] = (
    ("-m", "seed=range(0,0)"),
    ("-m", "seed=range(0,1000000000)"),
    ("-m", "seed=range(0,100000)", "ge.generations=range(1,100000)"),
    ("-m", "seed=range(0,10,0)"),
    ("-m", "seed="),
    ("seed=1,2",),
    ("seed",),
    ("=3",),
    ("seed=" + "1" * 5000,),
    ("seed=1e400",),
    ("seed=[[[[",),
    ("grammar.name=" + "[" * 2000,),
    ("grammar.name=" + "a" * 200_000 + " {",),
    ("grammar.name=\x1b[31mred",),
    ("ge.population_size=2000000000",),
    ("ge=null",),
    ("++ge.foo=1",),
    ("~ge.generations=3",),
    ("~env",),
    ("env=../../../../etc/passwd",),
    ("env=/etc/passwd",),
    ("env=" + "a" * 5000,),
    ("env.id=Nothing-v0",),
    ("env.id=no_such_module:Name-v0",),
    ("env.id=os:system-v0",),
    ("env.wrappers=[os:system]",),
    ("env.dynamics=nothing.py:Cart",),
    ("env.dynamics=/dev/zero",),
    ("env.kwargs={gravity: 5}",),
    ("env.symmetry={negate: [nothing]}",),
    ("grammar.bnf=''",),
    ("grammar.bnf='<a> ::='",),
    ("grammar.bnf='<a> ::= <b>'",),
    ("seed=${seed}",),
    ("seed=${oc.env:HOME}",),
    ("seed=${nothing}",),
    ("hydra.run.dir=",),
    ("hydra/launcher=nothing",),
    ("--config-name", "nothing"),
    ("--config-path", "/nothing"),
    ("--config-dir", "/nothing"),
    ("--nonsense",),
    ("-m", "seed=1", "--multirun=3"),
)
_FILES: dict[str, bytes] = {
    "empty": b"",
    "null": b"null\n",
    "a number": b"5\n",
    "a list": b"- 1\n- 2\n",
    "a text": b"settings\n",
    "binary": bytes(range(256)),
    "Latin-1": "grammar: {name: Übung}\n".encode("latin-1"),
    "UTF-16": "seed: 1\n".encode("utf-16"),
    "zeros": b"\0" * 100,
    "deep": b"seed: " + b"[" * 20_000 + b"]" * 20_000,
    "5,000 digits": b"seed: " + b"1" * 5000,
    "a date that is none": b"seed: 2001-13-45\n",
    "an object of Python": b"seed: !!python/object/apply:os.system [ls]\n",
    "a tag of nobody": b"seed: !nothing 5\n",
    "a key twice": b"env: {id: CartPole-v1}\nseed: 1\nseed: 2\n",
    "keys that are numbers": b"1: 2\n",
    "keys that are lists": b"? [1, 2]\n: 3\n",
    "tabs": b"ge:\n\tgenerations: 3\n",
    "a list where keys belong": b"env: {id: CartPole-v1}\nge: [1, 2]\n",
    "an alias of itself": b"env: &a {id: CartPole-v1, kwargs: *a}\n",
    "aliases that multiply": b"a0: &a0 [x, x]\n"
    + b"".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n".encode() for i in range(1, 10))
    + b"env: {id: CartPole-v1, kwargs: {a: *a9}}\n",
    "of 9 MiB": b"grammar: {name: " + b"a" * (9 << 20) + b"}\n",
}


def cases(folder: Path) -> Iterator[Case]:
    """Yield all bad configurations; files lie in `folder`."""
    sound = compose("CartPole-v1", {}, {}).as_mapping()
    yield Case("a sound one", lambda: Config.from_mapping(sound), PASSED)
    for key, rule in all_keys():
        for name, value in _VALUES.items():
            if not _is_allowed(key, rule.kind, name):
                yield Case(f"{key} is {name}", _composing(sound, {key: value}))
    for settings in _TOGETHER:
        yield Case(
            ", ".join(f"{key}={value}" for key, value in settings.items()), _composing(sound, settings)
        )
    for words in _WORDS:
        yield Case(" ".join(words)[:60], lambda words=words: check_composes(words))  # type: ignore[misc]
    for number, (name, content) in enumerate(_FILES.items()):
        path = folder / f"settings{number}.yaml"
        path.write_bytes(content)
        words = ("--config-path", str(folder), "--config-name", path.stem)
        yield Case(f"--config-name of a file that is {name}", lambda words=words: check_composes(words))  # type: ignore[misc]
        yield Case(
            f"an environment's file that is {name}", lambda path=path: plan(compose(str(path), {}, {}))
        )  # type: ignore[misc]
    yield from _odd_files(folder)


def _odd_files(folder: Path) -> Iterator[Case]:
    os.mkfifo(folder / "pipe.yaml")
    (folder / "device.yaml").symlink_to("/dev/zero")
    (folder / "folder.yaml").mkdir()
    for name in ("pipe", "device", "folder"):
        words = ("--config-path", str(folder), "--config-name", name)
        yield Case(f"--config-name of a {name}", lambda words=words: check_composes(words))  # type: ignore[misc]
        path = folder / f"{name}.yaml"
        yield Case(f"an environment's file that is a {name}", lambda path=path: compose(str(path), {}, {}))  # type: ignore[misc]


def _is_allowed(key: str, kind: str, name: str) -> bool:
    """Tell whether a value is not wrong for a key."""
    return (
        (kind == "mapping" and name == "keys with values")
        or (key in _TEXTS and name in ("a text", "a long text"))
        # The reader of grammars refuses them, but in comments.
        or (key == "grammar.bnf" and name == "escape codes")
        or (key in _SIGNED and name == "below 0")
        or (kind == "flag" and name == "true")
    )


def _composing(sound: dict[str, Any], settings: dict[str, Any]) -> Callable[[], Config]:
    def act() -> Config:
        values = copy.deepcopy(sound)
        for key, value in settings.items():
            node = values
            *sections, name = key.split(".")
            for section in sections:
                node = node[section]
            node[name] = value
        return Config.from_mapping(values)

    return act
