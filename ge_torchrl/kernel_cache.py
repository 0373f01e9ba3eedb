"""The cache of compiled kernels on disk: what is damaged there is compiled anew, and a full disk costs the cache alone.

numba reads the files of its cache without a check, and raises whatever that raises, at every start. Object code with a
flipped bit would even be run. So each file ends with its digest, which numba's reader never comes to. What it reads
executes: so it reads nothing that another user could have written.
"""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from numba.core.caching import IndexDataCacheFile

_logger = logging.getLogger(__name__)
_DIGEST_BYTES = hashlib.sha256().digest_size
_ROOT = 0
_OTHERS, _OTHERS_WRITE = 0o077, 0o022
# numba has no type information.
_Files: Any = IndexDataCacheFile
_told: set[str] = set()


class CheckedCacheFile(_Files):  # type: ignore[misc]
    """The files of one kernel, as numba keeps them, with a digest at their end."""

    def load(self, key: Any) -> Any:
        """Return what was saved under a key; None where nothing was, or it is damaged."""
        try:
            return super().load(key)
        except Exception as error:  # noqa: BLE001 - what is damaged may raise anything.
            self._tell_of_damage(error)
            return None

    def save(self, key: Any, data: Any) -> None:
        """Save the code under a key, where the disk takes it."""
        try:
            super().save(key, data)
        except OSError as error:
            tell_not_kept(Path(self._cache_path), error.strerror)

    def _load_index(self) -> Any:
        try:
            if Path(self._index_path).exists():
                _check_digest(Path(self._index_path))
            return super()._load_index()
        except Exception as error:  # noqa: BLE001 - likewise.
            self._tell_of_damage(error)
            return {}

    def _load_data(self, name: str) -> Any:
        _check_digest(Path(self._data_path(name)))
        return super()._load_data(name)

    @contextmanager
    def _open_for_write(self, path: str) -> Iterator[Any]:
        with super()._open_for_write(path) as file:
            yield file
            file.flush()
            file.write(hashlib.sha256(Path(file.name).read_bytes()).digest())

    def _tell_of_damage(self, error: Exception) -> None:
        tell_once(
            f"The cache of compiled kernels in {self._cache_path} is damaged ({' '.join(str(error).split())[:200]}); "
            "what is damaged is compiled anew."
        )


def _check_digest(path: Path) -> None:
    content = path.read_bytes()
    if hashlib.sha256(content[:-_DIGEST_BYTES]).digest() != content[-_DIGEST_BYTES:]:
        raise ValueError(f"{path.name} is not what was written")


def reason_against(folder: Path) -> str | None:
    """Return why no kernels are kept in a folder, which is made if need be; None where they can be.

    Args:
        folder: Of kernels alone.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.stat()
    except OSError as error:
        return error.strerror
    if os.name != "posix":
        return None  # Elsewhere the folders of a user are the user's.
    if found.st_uid not in (os.geteuid(), _ROOT):
        return "it is another user's"
    if found.st_mode & _OTHERS_WRITE:
        return "others can write there"
    if found.st_mode & _OTHERS:
        # What numba makes below it may be open to a group.
        with suppress(OSError):
            folder.chmod(0o700)
    return None


def tell_not_kept(folder: Path, reason: str | None) -> None:
    """Say once that kernels are compiled at each start, and why."""
    tell_once(f"Compiled kernels cannot be kept in {folder} ({reason}); they are compiled at each start.")


def tell_once(line: str) -> None:
    """Say something once in a process; a hundred kernels may have the same to say."""
    kind = line.partition(" in ")[0]
    if kind not in _told:
        _told.add(kind)
        _logger.warning(line)
