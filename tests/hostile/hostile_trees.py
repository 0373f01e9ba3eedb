"""Bad files of trees, and paths that name none."""

from __future__ import annotations

import copy
import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from hostile_verdicts import PASSED, Case

from ge_torchrl.report.reading import read_tree

_SOUND = {
    "format": "ge_torchrl.tree/2",
    "environment": {
        "id": "CartPole-v1",
        "kwargs": {},
        "wrappers": [],
        "max_episode_steps": None,
        "features": ["x", "x_dot", "theta", "theta_dot"],
        "units": ["m", "m/s", "rad", "rad/s"],
        "actions": ["left", "right"],
    },
    "splits": [
        {"terms": [{"feature": 2, "weight": 1.0}], "threshold": 0.01, "left": 1, "right": -3},
        {"terms": [{"feature": 3, "weight": 1.0}], "threshold": 0.2, "left": -1, "right": -2},
    ],
    "leaves": [{"action": 0}, {"action": 1}, {"action": 1}],
    "provenance": {},
}
_DIGITS = int("1" * 400)
_DEEP = "[" * 50_000 + "]" * 50_000
# Where in the document, and what stands there.
_CHANGES: dict[str, tuple[tuple[Any, ...], Any]] = {
    "format of tomorrow": (("format",), "ge_torchrl.tree/9"),
    "format is a list": (("format",), ["ge_torchrl.tree/2"]),
    "no environment": (("environment",), None),
    "id is a number": (("environment", "id"), 5),
    "id is empty": (("environment", "id"), ""),
    "id with escape codes": (("environment", "id"), "\x1b[2JCartPole-v1"),
    "id of a module that is missing": (("environment", "id"), "no_such_module:Name-v0"),
    "id of no environment": (("environment", "id"), "Nothing-v0"),
    "id of 100,000 characters": (("environment", "id"), "a" * 100_000),
    "id of a plant that is missing": (("environment", "id"), "no_such_plant.py:Cart"),
    "id of a relative module": (("environment", "id"), ".os:Name-v0"),
    "kwargs is a list": (("environment", "kwargs"), [1]),
    "kwargs that it does not take": (("environment", "kwargs"), {"nonsense": 1}),
    "a wrapper that is missing": (("environment", "wrappers"), ["no_such_module:Wrapper"]),
    "a wrapper that is a function": (("environment", "wrappers"), ["os:system"]),
    "a wrapper without a colon": (("environment", "wrappers"), ["FlattenObservation"]),
    "a wrapper with bad arguments": (("environment", "wrappers"), ["gymnasium.wrappers:ClipReward {a: [}"]),
    "wrappers is a text": (("environment", "wrappers"), "gymnasium.wrappers:ClipReward"),
    "limit below 1": (("environment", "max_episode_steps"), 0),
    "limit is huge": (("environment", "max_episode_steps"), _DIGITS),
    "no features": (("environment", "features"), []),
    "a feature too few": (("environment", "features"), ["x", "y", "z"]),
    "a feature with escape codes": (("environment", "features", 0), "\x1b[31mx"),
    "a feature of two lines": (("environment", "features", 0), "x\ny"),
    "a unit with escape codes": (("environment", "units", 0), "\x1b]0;owned\x07"),
    "an action that turns the writing": (("environment", "actions", 0), "\u202eleft"),
    "an action is a number": (("environment", "actions", 0), 1),
    "bounds of no action": (("environment", "action_bounds"), [[-1, 1]]),
    "bounds the wrong way": (("environment", "action_bounds"), [[1, -1], [0, 1]]),
    "splits is null": (("splits",), None),
    "a split too many": (("splits",), [*_SOUND["splits"], _SOUND["splits"][0]]),  # type: ignore[misc]
    "a split is a text": (("splits", 0), "x < 1"),
    "a feature that is not there": (("splits", 0, "terms", 0, "feature"), 4),
    "a negative feature": (("splits", 0, "terms", 0, "feature"), -1),
    "a feature of 400 digits": (("splits", 0, "terms", 0, "feature"), _DIGITS),
    "a weight of 400 digits": (("splits", 0, "terms", 0, "weight"), _DIGITS),
    "a weight is true": (("splits", 0, "terms", 0, "weight"), True),
    "no terms": (("splits", 0, "terms"), []),
    "an infinite threshold": (("splits", 0, "threshold"), float("inf")),
    "a threshold that is no number": (("splits", 0, "threshold"), float("nan")),
    "a threshold is a text": (("splits", 0, "threshold"), "0.01"),
    "a child that is the root": (("splits", 0, "left"), 0),
    "a circle": (("splits", 1, "left"), 1),
    "a child that is not there": (("splits", 0, "left"), 9),
    "a child is a fraction": (("splits", 0, "left"), 1.5),
    "an action that is not there": (("leaves", 0, "action"), 2),
    "an action below 0": (("leaves", 0, "action"), -1),
    "leaves of two kinds": (("leaves", 0), {"value": [0.0], "linear": []}),
    "provenance is a number": (("provenance",), 5),
    "a key too many": (("extra",), 1),
}
_TEXTS: dict[str, bytes] = {
    "empty": b"",
    "binary": bytes(range(256)),
    "Latin-1": '{"id": "Übung"}'.encode("latin-1"),
    "UTF-16": json.dumps(_SOUND).encode("utf-16"),
    "a key twice": b'{"format": "ge_torchrl.tree/2", "format": "ge_torchrl.tree/2"}',
    "half of one": json.dumps(_SOUND).encode()[:300],
    "deep": _DEEP.encode(),
    "5,000 digits": f'{{"format": {"1" * 5000}}}'.encode(),
    "a pickle": b"\x80\x04\x95\x1a\x00\x00\x00\x00\x00\x00\x00\x8c\x02os\x94\x8c\x06system\x94",
    "a list": b"[]",
}


def cases(folder: Path) -> Iterator[Case]:
    """Yield all bad trees; their files lie in `folder`."""
    yield Case("a sound tree", _meeting(_written(folder / "sound.json", json.dumps(_SOUND).encode())), PASSED)
    for number, (name, (place, value)) in enumerate(_CHANGES.items()):
        content = json.dumps(_changed(place, value)).encode()
        yield Case(name, _meeting(_written(folder / f"changed{number}.json", content)))
    for number, (name, content) in enumerate(_TEXTS.items()):
        yield Case(f"the file is {name}", _meeting(_written(folder / f"text{number}.json", content)))
    yield from _paths(folder)


def sound_document() -> dict[str, Any]:
    """Return a copy of what a sound file says."""
    return copy.deepcopy(_SOUND)


def _paths(folder: Path) -> Iterator[Case]:
    pipe, circle = folder / "pipe.json", folder / "circle.json"
    os.mkfifo(pipe)
    circle.symlink_to(circle.name)
    for name, path in {
        "a pipe": pipe,
        "a device without an end": Path("/dev/zero"),
        "a device without content": Path("/dev/null"),
        "a link to itself": circle,
        "a path of 5,000 characters": Path("a" * 5000),
        "a path of many folders": Path("a/" * 3000 + "tree.json"),
        "a path with escape codes": folder / "\x1b[31mtree.json",
        "a path with a zero": Path("tree\0.json"),
        "an empty folder": folder,
        "nothing": folder / "nothing.json",
    }.items():
        yield Case(f"the path is {name}", _meeting(path))
        yield Case(f"a tree of 3 nodes of {name}", lambda path=path: read_tree(path, 3))  # type: ignore[misc]


def _changed(place: tuple[Any, ...], value: object) -> dict[str, Any]:
    document = sound_document()
    inner: Any = document
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    return document


def _written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def _meeting(path: Path) -> Callable[[], object]:
    return lambda: read_tree(path, None)
