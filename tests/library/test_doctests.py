"""What the docstrings of the library and its page show is what happens."""

import doctest
import importlib

import pytest
from pages_for_tests import ROOT, blocks

import ge_torchrl

OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
MODULES = sorted({module for module in ge_torchrl._HOMES.values() if module.startswith("library.")})


@pytest.fixture(autouse=True)
def at_the_root(monkeypatch):
    monkeypatch.chdir(ROOT)


@pytest.mark.parametrize("name", MODULES)
def test_docstrings(name):
    failed, _ = doctest.testmod(importlib.import_module(f"ge_torchrl.{name}"), optionflags=OPTIONS)
    assert failed == 0


def test_the_page():
    text = "\n".join(blocks(ROOT / "docs" / "library.md", "pycon"))
    page = doctest.DocTestParser().get_doctest(text, {}, "docs/library.md", None, None)
    failed, tried = doctest.DocTestRunner(optionflags=OPTIONS).run(page)
    assert failed == 0
    assert tried > 25
