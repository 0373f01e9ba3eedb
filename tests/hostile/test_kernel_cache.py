"""A cache of kernels that is damaged, empty, half written or on a full disk costs a compilation, and one line."""

import errno
import logging
import os

import numba.core.caching
import pytest

from ge_torchrl import compilation, kernel_cache
from ge_torchrl.compilation import compiled_in


def add(x, y):
    return x + y


@pytest.fixture(autouse=True)
def nothing_told(monkeypatch):
    monkeypatch.setattr(kernel_cache, "_told", set())
    compilation._reason_against.cache_clear()


def hits(folder):
    """Compute with the kernel, and tell whether it came from the cache."""
    kernel = compiled_in(folder)(add)
    assert kernel(1.0, 2.0) == 3.0
    return sum(kernel.stats.cache_hits.values())


def emptied(path):
    path.write_bytes(b"")


def halved(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flipped(path):
    content = bytearray(path.read_bytes())
    content[-20] ^= 1
    path.write_bytes(content)


def replaced(path):
    path.write_bytes(b"nobody's")


@pytest.mark.parametrize("damage", [emptied, halved, flipped, replaced])
@pytest.mark.parametrize("ending", ["nbi", "nbc"])
def test_what_is_damaged_is_compiled_anew_and_told_once(ending, damage, tmp_path, caplog):
    assert hits(tmp_path) == 0
    assert hits(tmp_path) == 1
    (path,) = tmp_path.rglob(f"*.{ending}")
    damage(path)
    with caplog.at_level(logging.WARNING):
        assert hits(tmp_path) == 0
        assert hits(tmp_path) == 1, "it is sound again"
    (told,) = caplog.messages
    assert "compiled kernels" in told
    assert told.endswith("what is damaged is compiled anew.")


def test_on_a_full_disk_a_kernel_is_compiled_in_memory(tmp_path, monkeypatch, caplog):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(numba.core.caching.IndexDataCacheFile, "_open_for_write", full)
    with caplog.at_level(logging.WARNING):
        assert hits(tmp_path) == 0
        assert hits(tmp_path) == 0
    (told,) = caplog.messages
    assert told.startswith(f"Compiled kernels cannot be kept in {tmp_path}")
    assert told.endswith("(No space left on device); they are compiled at each start.")


def test_where_no_folder_can_be_written_a_kernel_is_compiled_in_memory(tmp_path, monkeypatch, caplog):
    def refused(*_):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(numba.core.caching._CacheLocator, "ensure_cache_path", refused)
    with caplog.at_level(logging.WARNING):
        assert hits(tmp_path) == 0
    assert caplog.messages == [
        f"Compiled kernels cannot be kept in {tmp_path} (it cannot be written); they are compiled at each start."
    ]


@pytest.mark.skipif(os.name != "posix", reason="the system keeps folders otherwise")
class TestFoldersOfOthers:
    """numba's files execute when they are read."""

    def told(self, folder, caplog):
        with caplog.at_level(logging.WARNING):
            assert hits(folder) == 0
        assert not list(folder.rglob("*.nb*"))
        (told,) = caplog.messages
        return told

    @pytest.mark.parametrize("mode", [0o777, 0o770, 0o702])
    def test_where_others_can_write_nothing_is_read_or_kept(self, mode, tmp_path, caplog):
        folder = tmp_path / "open"
        folder.mkdir()
        folder.chmod(mode)
        told = self.told(folder, caplog)
        assert (
            told
            == f"Compiled kernels cannot be kept in {folder} (others can write there); they are compiled at each start."
        )

    def test_nor_where_the_folder_is_another_users(self, tmp_path, monkeypatch, caplog):
        monkeypatch.setattr(kernel_cache, "_ROOT", -1)
        monkeypatch.setattr(os, "geteuid", lambda: tmp_path.stat().st_uid + 1)
        assert "(it is another user's)" in self.told(tmp_path / "theirs", caplog)

    def test_a_folder_that_is_made_is_this_users_alone(self, tmp_path):
        assert hits(tmp_path / "new" / "deep") == 0
        assert (tmp_path / "new" / "deep").stat().st_mode & 0o777 == 0o700

    def test_one_that_others_can_read_is_closed_to_them(self, tmp_path):
        tmp_path.chmod(0o755)
        assert hits(tmp_path) == 0
        assert tmp_path.stat().st_mode & 0o777 == 0o700
        assert hits(tmp_path) == 1
