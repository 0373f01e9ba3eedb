import pytest
from hypothesis import given
from hypothesis import strategies as st

from ge_torchrl.report.printable import printable

DRAWN = "theta < 1?\n├─ yes: left\n│       └─ no:  right ± 1"


def test_a_drawing_in_ascii():
    assert printable(DRAWN, "ascii") == "theta < 1?\n|- yes: left\n|       '- no:  right +- 1"


@pytest.mark.parametrize("encoding", ["utf-8", "cp437"])
def test_what_can_be_shown_is_shown(encoding):
    assert printable(DRAWN.replace("±", ""), encoding) == DRAWN.replace("±", "")


@given(st.text(), st.sampled_from([None, "ascii", "latin-1", "cp437", "utf-8"]))
def test_every_text_can_be_written(text, encoding):
    printable(text.replace("\ud800", ""), encoding).encode(encoding or "ascii", errors="strict")
