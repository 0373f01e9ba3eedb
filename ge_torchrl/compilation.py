"""Compiled kernels: one decorator over numba, with a cache that knows when any kernel's source changed.

numba's own file cache looks only at the file of the function itself, so a kernel that inlines a function, or a
constant, of another module would go stale when that module changes. Here the cache folder's name is a digest of
all sources on the floors that have kernels: an edit there compiles anew, unchanged sources never compile twice. It is
one of the processor too: two processors that share a folder could take each other's files.
"""

import contextlib
import functools
import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import caching, config, event
from numba.core.registry import cpu_target

from ge_torchrl.interrupts import begin_unbroken, end_unbroken
from ge_torchrl.kernel_cache import CheckedCacheFile, reason_against, tell_not_kept

_Function = TypeVar("_Function", bound=Callable[..., Any])
_PACKAGE = Path(__file__).resolve().parent
# Kernels live on these floors and take functions and constants from them alone.
_FLOORS_WITH_KERNELS = ("trees", "ge", "environments")
# Of the files; see `kernel_cache`.
_FORMAT = 3
# numba has no type information.
_events: Any = event
_Listener: Any = event.Listener
# The ending of an empty file, named after a kind of run.
_CALLED = ".called"


class _Compiling(_Listener):  # type: ignore[misc]
    """numba at work: broken off it leaves tracebacks, and code that it takes for compiled."""

    def on_start(self, event: Any) -> None:  # noqa: ARG002 (numba's own form)
        begin_unbroken()

    def on_end(self, event: Any) -> None:  # noqa: ARG002
        end_unbroken()


_events.register("numba:compiler_lock", _Compiling())


@functools.cache
def cache_directory() -> Path:
    """Return the folder of the kernels that these sources compile to on this processor.

    It lies in `$NUMBA_CACHE_DIR` where that is set, else beside the sources where this user alone can write there, else
    in the user's cache folder.
    """
    digest = hashlib.sha256(f"{_FORMAT} {_processor()}".encode())
    for source in sorted(path for floor in _FLOORS_WITH_KERNELS for path in (_PACKAGE / floor).rglob("*.py")):
        digest.update(source.relative_to(_PACKAGE).as_posix().encode())
        digest.update(source.read_bytes())
    name = f"kernels-{digest.hexdigest()[:16]}"
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(chosen) / name
    beside = _PACKAGE / "__pycache__"
    can_write = os.access(beside if beside.exists() else _PACKAGE, os.W_OK)
    if can_write and reason_against(beside / name) is None:
        return beside / name
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "ge_torchrl" / name


def _processor() -> str:
    """Return what numba compiles for, as its own cache tells it: the kind of machine, the processor, its features."""
    return repr(cpu_target.target_context.codegen().magic_tuple())


def compiled(function: _Function) -> _Function:
    """Compile a function with numba: cached on disk, free of the GIL, strict IEEE arithmetic.

    No fast-math: the same operation must give the same bits in every lane and on every thread (law 6). Division
    follows NumPy (no exception), without which LLVM does not vectorise.
    """
    return _compiled(function, forceinline=False)


def inlined(function: _Function) -> _Function:
    """Compile a function into each of its callers, as `compiled` does it.

    A call counts the references to every array that it takes, atomically. In an inner loop that costs more than the
    work of a small function.
    """
    return _compiled(function, forceinline=True)


def compiled_in(folder: Path) -> Callable[[_Function], _Function]:
    """Return what compiles as `compiled` does, its cache in a folder whose name knows all that is compiled there."""
    return functools.partial(_compiled, forceinline=False, folder=folder)


def entry_in(folder: Path) -> Callable[[Callable[..., Any]], Any]:
    """Return what compiles a function as `void(double *lanes, intp n)`, to be called by its address."""

    def decorate(function: Callable[..., Any]) -> Any:
        types: Any = numba.types
        signature = types.void(types.CPointer(types.float64), types.intp)
        with _caching_in(folder):
            return _cached(lambda *, cache: numba.cfunc(signature, cache=cache)(function), folder)

    return decorate


def _compiled(function: _Function, *, forceinline: bool, folder: Path | None = None) -> _Function:
    def decorated(*, cache: bool) -> Any:
        return numba.njit(cache=cache, nogil=True, error_model="numpy", forceinline=forceinline)(function)

    place = folder or cache_directory()
    with _caching_in(place):
        dispatcher = _cached(decorated, place)
    return cast("_Function", dispatcher)


def _cached(compiling: Callable[..., Any], folder: Path) -> Any:
    """Return what compiles with a cache on disk; without one where no folder can be written by this user alone."""
    reason = _reason_against(folder)
    try:
        if reason is None:
            return compiling(cache=True)
    except RuntimeError as error:
        if "cannot cache function" not in str(error):
            raise
        reason = "it cannot be written"
    tell_not_kept(folder, reason)
    return compiling(cache=False)


# A hundred kernels ask for the same folder.
_reason_against = functools.cache(reason_against)


@contextmanager
def _caching_in(folder: Path) -> Iterator[None]:
    # The settings of numba are a module's attributes, which its type information does not list.
    settings: Any = config
    files: Any = caching
    previous = settings.CACHE_DIR, files.IndexDataCacheFile
    settings.CACHE_DIR, files.IndexDataCacheFile = str(folder), CheckedCacheFile
    try:
        yield
    finally:
        settings.CACHE_DIR, files.IndexDataCacheFile = previous


def is_compiled_before(kind: str) -> bool:
    """Tell whether runs of a kind found this version's kernels compiled for this processor, or compiled them."""
    return (cache_directory() / f"{kind}{_CALLED}").exists()


def note_compiled(kind: str) -> None:
    """Remember that the kernels which runs of a kind call are compiled."""
    # Where nothing can be written, nothing is cached either.
    with contextlib.suppress(OSError):
        cache_directory().mkdir(parents=True, exist_ok=True)
        (cache_directory() / f"{kind}{_CALLED}").touch()
