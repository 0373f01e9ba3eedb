import math
import shutil
from pathlib import Path

import numba.core.config as numba_config
import pytest
from numba.core.compiler_lock import global_compiler_lock

from ge_torchrl import compilation, interrupts
from ge_torchrl.compilation import cache_directory, compiled, inlined


@pytest.fixture
def fresh_cache_directory():
    cache_directory.cache_clear()
    yield cache_directory
    cache_directory.cache_clear()


@pytest.fixture
def package(tmp_path, monkeypatch, fresh_cache_directory):
    """A copy of the package that a test may edit, and the folder that its kernels would go to."""
    copy = tmp_path / "package"
    shutil.copytree(Path(compilation.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(compilation, "_PACKAGE", copy)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)

    def directory():
        fresh_cache_directory.cache_clear()
        return fresh_cache_directory()

    return copy, directory


def divide(numerator, denominator):
    return numerator / denominator


def test_kernel_is_compiled_cached_and_divides_like_numpy(tmp_path, monkeypatch, fresh_cache_directory):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    kernel = compiled(divide)
    assert kernel(1.0, 4.0) == 0.25
    assert kernel(1.0, 0.0) == math.inf
    assert kernel.targetoptions["nogil"]
    assert not kernel.targetoptions.get("fastmath", False)
    assert list(fresh_cache_directory().rglob("*.nbi"))
    again = compiled(divide)
    again(1.0, 4.0)
    assert sum(again.stats.cache_hits.values()) == 1


def test_what_is_inlined_computes_the_same_by_the_same_rules():
    kernel = inlined(divide)
    assert kernel(1.0, 4.0) == 0.25
    assert kernel(1.0, 0.0) == math.inf
    assert kernel.targetoptions["forceinline"]
    assert kernel.targetoptions["nogil"]


def test_a_kernel_is_compiled_unbroken():
    before = interrupts._Unbroken.depth
    with global_compiler_lock:
        assert interrupts._Unbroken.depth == before + 1
    assert interrupts._Unbroken.depth == before


def test_decorating_leaves_numba_settings_as_they_were():
    before = numba_config.CACHE_DIR
    compiled(divide)
    assert before == numba_config.CACHE_DIR


def test_an_edit_of_any_module_changes_the_cache(package):
    copy, directory = package
    before = directory()
    assert directory() == before
    with (copy / "trees" / "tree.py").open("a") as source:
        source.write("# edited\n")
    edited = directory()
    assert edited != before
    (copy / "trees" / "tree.py").rename(copy / "trees" / "bush.py")
    assert directory() not in (before, edited)


def test_what_another_processor_compiled_is_not_compiled_before(package, monkeypatch):
    _, directory = package
    kernels = directory()
    (kernels / "kernel.nbi").touch()
    assert not compilation.is_compiled_before("sums"), "these may be the kernels of another kind of run"
    compilation.note_compiled("sums")
    assert compilation.is_compiled_before("sums")
    assert not compilation.is_compiled_before("actions")
    monkeypatch.setattr(numba_config, "CPU_NAME", "nehalem")
    assert directory() != kernels
    assert not compilation.is_compiled_before("sums")


@pytest.mark.usefixtures("package")
def test_where_nothing_can_be_written_nothing_is_remembered(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))
    compilation.note_compiled("sums")
    assert not compilation.is_compiled_before("sums")


def test_cache_lies_beside_the_sources_where_they_can_be_written(package):
    copy, directory = package
    assert directory().parent == copy / "__pycache__"


def test_cache_lies_in_the_users_folder_where_sources_are_read_only(package, tmp_path, monkeypatch):
    _, directory = package
    monkeypatch.setattr("os.access", lambda *_: False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    assert directory().parent == tmp_path / "user" / "ge_torchrl"


def test_cache_lies_in_the_users_folder_where_others_write_beside_the_sources(package, tmp_path, monkeypatch):
    _, directory = package
    directory().chmod(0o777)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    assert directory().parent == tmp_path / "user" / "ge_torchrl"


def test_cache_lies_where_numba_is_told_to(package, tmp_path, monkeypatch):
    _, directory = package
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    assert directory().parent == tmp_path / "numba"
