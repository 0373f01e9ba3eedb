"""The file of a plant: found, run with other numbers where those are asked for, and known by digests."""

from __future__ import annotations

import ast
import hashlib
import importlib.machinery
import importlib.util
import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from ge_torchrl.environments.plants.values import is_number
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.printing import said_of


def found(file: str, dynamics: str) -> Path:
    """Return the path of a file, seen from the current folder, else from a folder of PYTHONPATH.

    Raises:
        EnvironmentFaultError: It is nowhere there.
    """
    given = Path(file)
    # Joining an absolute path gives that path.
    folders = list(dict.fromkeys([Path.cwd(), *(Path(entry) for entry in sys.path if entry)]))
    for folder in folders:
        if (folder / given).is_file():
            return folder / given
    where = "it is not there" if given.is_absolute() else f"it is neither in {Path.cwd()} nor on PYTHONPATH"
    raise EnvironmentFaultError(
        f"env.dynamics={dynamics} must name a file, seen from the current folder or a folder of PYTHONPATH; {where}"
    )


class _Loader(importlib.machinery.SourceFileLoader):
    """Compiles a file anew: Python takes a file for unchanged that was written twice within a second."""

    def __init__(self, name: str, path: str, numbers: Mapping[str, float]) -> None:
        super().__init__(name, path)
        self._numbers = numbers

    def get_code(self, fullname: str) -> Any:
        path = self.get_filename(fullname)
        parsed = ast.parse(self.get_data(path), path)
        # Right behind a number's own line, so that what the file computes of it follows.
        parsed.body = [line for each in parsed.body for line in (each, *self._changes(each))]
        compiled: Any = self.source_to_code(parsed, path)
        return compiled

    def _changes(self, line: ast.stmt) -> Iterator[ast.stmt]:
        for name in _assigned(line):
            if name in self._numbers:
                change = ast.Assign([ast.Name(name, ast.Store())], ast.Constant(self._numbers[name]))
                yield ast.fix_missing_locations(ast.copy_location(change, line))


def _assigned(line: ast.stmt) -> Iterator[str]:
    """Yield the names to which a line of a file gives a value."""
    targets: list[ast.expr] = []
    if isinstance(line, ast.Assign):
        targets = line.targets
    elif isinstance(line, ast.AnnAssign | ast.AugAssign):
        targets = [line.target]
    for target in targets:
        entries = target.elts if isinstance(target, ast.Tuple | ast.List) else [target]
        yield from (entry.id for entry in entries if isinstance(entry, ast.Name))


def numbers_of(module: ModuleType, source: bytes) -> dict[str, float]:
    """Return the numbers that stand in a file under names of their own, outside of classes and functions."""
    names = [name for line in ast.parse(source).body for name in _assigned(line)]
    values = {name: getattr(module, name, None) for name in names}
    return {
        name: value for name, value in values.items() if isinstance(value, int | float) and is_number(value)
    }


def run_file(path: Path, source: bytes, numbers: Mapping[str, float], dynamics: str) -> ModuleType:
    """Return the module that a file makes.

    Args:
        path: The file.
        source: Its content.
        numbers: By name, what takes the place of numbers in it.
        dynamics: How it was named.

    Raises:
        EnvironmentFaultError: It is no Python, or raises.
    """
    # Compiled code in the cache asks for its module by this name, wherever the file lies by then.
    changes = json.dumps(numbers, sort_keys=True).encode() if numbers else b""
    name = f"plant_{hashlib.sha256(source + changes).hexdigest()[:16]}"
    spec = importlib.util.spec_from_file_location(name, path, loader=_Loader(name, str(path), numbers))
    if spec is None or spec.loader is None:
        raise EnvironmentFaultError(f"env.dynamics={dynamics} must name a Python file; got {path}")
    module = importlib.util.module_from_spec(spec)
    # Where numba looks for it.
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except SyntaxError as error:
        raise EnvironmentFaultError(
            f"env.dynamics={dynamics} must be Python; {path.name}, line {error.lineno}: {error.msg}"
        ) from error
    except (Exception, SystemExit) as error:
        raise EnvironmentFaultError(
            f"env.dynamics={dynamics} raised {said_of(error)} when {path.name} was read"
        ) from error
    return module


def source_digest(module: ModuleType, source: bytes) -> str:
    """Return what changes with the text of a plant, its own file and others of the user's, on any machine."""
    own = Path(module.__file__ or "")
    others = [path for path in _taken_from(module) if "site-packages" not in path.parts and path != own]
    texts = [source, *sorted(path.read_bytes() for path in others)]
    return hashlib.sha256(b"".join(text.replace(b"\r\n", b"\n") for text in texts)).hexdigest()[:16]


def code_digest(described: type, module: ModuleType, source: bytes) -> str:
    """Return what changes whenever the compiled code has to: of the file, and of what it takes from others."""
    digest = hashlib.sha256(source + f"{described.__qualname__} {module.__name__}".encode())
    for name, value in sorted(vars(module).items()):
        if not name.startswith("__") and isinstance(value, int | float | str | tuple):
            digest.update(f"{name}={value!r}".encode())
    for path in _taken_from(module):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _taken_from(module: ModuleType) -> list[Path]:
    """Return the Python files, those of Python itself aside, in which the names of a module are at home."""
    files = set()
    for value in vars(module).values():
        owner = value if isinstance(value, ModuleType) else sys.modules.get(getattr(value, "__module__", ""))
        if file := getattr(owner, "__file__", None):
            files.add(Path(file))
    return sorted(
        path
        for path in files
        if path.suffix == ".py" and path.is_file() and not path.is_relative_to(sys.base_prefix)
    )
