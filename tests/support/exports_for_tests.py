"""Formats as parameters of tests; C is compiled, where there is a compiler."""

import shutil

import pytest

from ge_torchrl.exports.formats import FORMATS

needs_compiler = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="there is no C compiler"
)


def formats(names=tuple(FORMATS)):
    return [pytest.param(to, marks=needs_compiler) if to == "c" else to for to in names]
