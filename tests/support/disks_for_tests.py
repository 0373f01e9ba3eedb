"""A disk that is pulled out, or full, at a chosen moment of what a run writes."""

import errno
import os

from ge_torchrl.artefacts import texts


class KilledError(BaseException):
    """What no code of a run answers to: as when the process is gone."""


class Disk:
    """Stands in for `os` where artefacts are written.

    Args:
        dies_at: The call of write, fsync or replace, counted from 0, in which the process dies; None for never.
        room: Bytes that it takes; None for any.

    Attributes:
        calls: What was called so far.
        written: Bytes so far.
    """

    def __init__(self, dies_at=None, room=None):
        self._dies_at, self.room = dies_at, room
        self.calls, self.written = [], 0

    def __getattr__(self, name):
        return getattr(os, name)

    def _call(self, name):
        self.calls.append(name)
        if self._dies_at is not None and len(self.calls) > self._dies_at:
            raise KilledError

    def write(self, descriptor, content):
        try:
            self._call("write")
        except KilledError:
            if len(self.calls) == self._dies_at + 1:
                os.write(descriptor, content[: len(content) // 2])
            raise
        if self.room is not None:
            content = content[: max(0, self.room - self.written)]
            if not content:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.written += len(content)
        return os.write(descriptor, content)

    def fsync(self, descriptor):
        self._call("fsync")
        os.fsync(descriptor)

    def replace(self, source, target):
        self._call("replace")
        os.replace(source, target)  # noqa: PTH105

    def __enter__(self):
        texts.os = self
        return self

    def __exit__(self, *_):
        texts.os = os
