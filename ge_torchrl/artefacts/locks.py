"""The lock of a run's folder: one process at a time writes there; the system takes it from a process that dies."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ge_torchrl.artefacts.texts import told_of
from ge_torchrl.errors import ArtefactError

LOCK, JOB_LOCK = ".lock", ".job.lock"


class Lock:
    """Holds the lock of a folder from its making until `release`.

    Args:
        folder: The folder.
        name: Of the file that is locked: a job of a sweep holds one more, since it begins before its run writes.

    Raises:
        ArtefactError: Another process holds it, or the folder cannot be written.
    """

    def __init__(self, folder: Path, name: str = LOCK) -> None:
        self._path = folder / name
        self._descriptor: int | None = None
        # Whoever held it may have removed the file between its opening and its locking here.
        while self._descriptor is None:
            self._descriptor = self._locked(folder)

    def _locked(self, folder: Path) -> int | None:
        with told_of(folder):
            descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            _lock(descriptor)
            if _is_same(descriptor, self._path):
                os.ftruncate(descriptor, 0)
                os.write(descriptor, f"{os.getpid()}\n".encode())
                return descriptor
        except BlockingIOError as error:
            holder = os.read(descriptor, 20).decode(errors="replace").strip() or "unknown"
            os.close(descriptor)
            raise ArtefactError(
                f"{folder} must be a folder that no other process writes to; the run in it goes on in process {holder}"
            ) from error
        except OSError as error:
            os.close(descriptor)
            raise ArtefactError(f"{self._path} cannot be locked: {error.strerror}") from error
        os.close(descriptor)
        return None

    def release(self) -> None:
        """Give the lock back; it may be called again."""
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            with suppress(OSError):
                self._path.unlink()
            os.close(descriptor)


@contextmanager
def in_turn(path: Path) -> Iterator[None]:
    """Wait until no other process is within this for the same path, and keep others waiting meanwhile.

    Args:
        path: A file of no content, which is made and stays.

    Raises:
        ArtefactError: It cannot be written.
    """
    with told_of(path):
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        _lock(descriptor, waits=True)
        yield
    finally:
        os.close(descriptor)


def is_locked(folder: Path) -> bool:
    """Tell whether a process holds the lock of a folder, as a run or as a job of a sweep."""
    return any(_is_locked(folder / name) for name in (LOCK, JOB_LOCK))


def _is_locked(path: Path) -> bool:
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except OSError:
        return False
    try:
        _lock(descriptor)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return False


def _is_same(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


def _lock(descriptor: int, *, waits: bool = False) -> None:
    """Lock an open file.

    Raises:
        BlockingIOError: Another process has locked it, and this one does not wait.
    """
    try:
        import fcntl
    except ImportError:  # Windows has no such locks, and its runs none.
        return
    fcntl.flock(descriptor, fcntl.LOCK_EX if waits else fcntl.LOCK_EX | fcntl.LOCK_NB)
