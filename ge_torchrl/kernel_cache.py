"""The cache of compiled kernels on disk: what is damaged there is compiled anew, and a full disk costs the cache alone.

numba reads the files of its cache without a check, and raises whatever that raises, at every start. Object code with a
flipped bit would even be run. So each file of code begins with its digest.
"""

from __future__ import annotations

import hashlib
import logging
import pickle
from pathlib import Path
from typing import Any

from numba.core.caching import IndexDataCacheFile

_logger = logging.getLogger(__name__)
_DIGEST_BYTES = hashlib.sha256().digest_size
# numba has no type information.
_Files: Any = IndexDataCacheFile
_told: set[str] = set()


class CheckedCacheFile(_Files):  # type: ignore[misc]
    """The files of one kernel, as numba keeps them, with a digest in front of the code."""

    def load(self, key: Any) -> Any:
        """Return what was saved under a key; None where nothing was, or it is damaged."""
        try:
            return super().load(key)
        except Exception as error:  # noqa: BLE001 - a pickle that is damaged may raise anything.
            self._tell_of_damage(error)
            return None

    def save(self, key: Any, data: Any) -> None:
        """Save the code under a key, where the disk takes it."""
        try:
            super().save(key, data)
        except OSError as error:
            tell_once(
                f"Compiled kernels cannot be kept in {self._cache_path} ({error.strerror}); they are compiled at each "
                "start."
            )

    def _load_index(self) -> Any:
        try:
            return super()._load_index()
        except Exception as error:  # noqa: BLE001 - likewise.
            self._tell_of_damage(error)
            return {}

    def _load_data(self, name: str) -> Any:
        content = Path(self._data_path(name)).read_bytes()
        digest, code = content[:_DIGEST_BYTES], content[_DIGEST_BYTES:]
        if hashlib.sha256(code).digest() != digest:
            raise ValueError(f"{name} is not what was written")
        return pickle.loads(code)  # noqa: S301 (numba's own cache, in a folder of the user's)

    def _save_data(self, name: str, data: Any) -> None:
        code = self._dump(data)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(hashlib.sha256(code).digest() + code)

    def _tell_of_damage(self, error: Exception) -> None:
        tell_once(
            f"The cache of compiled kernels in {self._cache_path} is damaged ({' '.join(str(error).split())[:200]}); "
            "what is damaged is compiled anew."
        )


def tell_once(line: str) -> None:
    """Say something once in a process; a hundred kernels may have the same to say."""
    kind = line.partition(" in ")[0]
    if kind not in _told:
        _told.add(kind)
        _logger.warning(line)
