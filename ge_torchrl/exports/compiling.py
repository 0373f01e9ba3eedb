"""Compiling and running the C that an export has written."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.errors import RunFaultError
from ge_torchrl.exports.extras import UNVERIFIED, MissingToolError
from ge_torchrl.exports.written import Written
from ge_torchrl.trees.tree import FloatArray

_COMPILERS = ("cc", "gcc", "clang")
_FLAGS = ("-std=c99", "-O1")
_SECONDS = 120
# Reads rows of one controller after the other, and writes what each answers.
_ROWS = """\
    {{
        static float observation[{n_features}];
        {kind} action[{n_values}];
        for (long row = 0; row < {n_rows}; row++) {{
            if (fread(observation, sizeof observation, 1, stdin) != 1) return 1;
            {call};
            if (fwrite(action, sizeof action, 1, stdout) != 1) return 1;
        }}
    }}
"""


def answers(
    written: Sequence[Written], observed: Sequence[FloatArray], flags: Sequence[str] = _FLAGS
) -> list[NDArray[Any]]:
    """Return what C answers to [B, D] observations of each function, all of them compiled as one program.

    Args:
        written: The functions, of different names.
        observed: [B, D] float32 of each.
        flags: Of the compiler.

    Raises:
        MissingToolError: There is no compiler.
        RunFaultError: It refuses the program, or the program fails.
    """
    compiler = _compiler()
    with tempfile.TemporaryDirectory() as folder:
        source, program = Path(folder) / "exported.c", Path(folder) / "exported"
        source.write_bytes(_program(written, observed))
        _told([*compiler, *flags, "-o", str(program), str(source)], b"")
        output = _told([str(program)], b"".join(rows.tobytes() for rows in observed))
    found: list[NDArray[Any]] = []
    place = 0
    for one, rows in zip(written, observed, strict=True):
        has_actions, n_values = one.controller.tree.has_actions, len(one.controller.names.actions)
        end = place + 4 * len(rows) * (1 if has_actions else n_values)
        numbers = np.frombuffer(output[place:end], np.int32 if has_actions else np.float32)
        found.append(numbers if has_actions else numbers.reshape(len(rows), n_values))
        place = end
    return found


def _compiler() -> list[str]:
    named = shlex.split(os.environ.get("CC", ""))
    for compiler in [named] if named else [[each] for each in _COMPILERS]:
        if shutil.which(compiler[0]):
            return compiler
    wanted = named[0] if named else ", ".join(_COMPILERS)
    raise MissingToolError(
        f"C is verified by compiling it, so expected a compiler ({wanted}); found none; install one, {UNVERIFIED}"
    )


def _program(written: Sequence[Written], observed: Sequence[FloatArray]) -> bytes:
    parts = [
        b"#include <stdint.h>\n#include <stdio.h>\n",
        *(one.content for one in written),
        b"int main(void)\n{\n",
    ]
    for one, rows in zip(written, observed, strict=True):
        has_actions = one.controller.tree.has_actions
        call = f"action[0] = {one.name}(observation)" if has_actions else f"{one.name}(observation, action)"
        text = _ROWS.format(
            n_features=len(one.controller.names.features),
            kind="int32_t" if has_actions else "float",
            n_values=1 if has_actions else len(one.controller.names.actions),
            n_rows=len(rows),
            call=call,
        )
        parts.append(text.encode())
    return b"".join([*parts, b"    return 0;\n}\n"])


def _told(command: Sequence[str], given: bytes) -> bytes:
    """Return what a program writes."""
    try:
        ended = subprocess.run(command, input=given, capture_output=True, check=True, timeout=_SECONDS)  # noqa: S603
    except subprocess.TimeoutExpired as error:
        raise RunFaultError(f"{command[0]} did not end within {_SECONDS} s") from error
    except subprocess.CalledProcessError as error:
        said = error.stderr.decode(errors="replace").strip().splitlines()
        reason = next((line for line in said if "error" in line), said[0] if said else "no message")
        raise RunFaultError(
            f"{Path(command[0]).name} failed with status {error.returncode}: {reason}"
        ) from error
    return ended.stdout
