import sys

import pytest

from ge_torchrl.errors import UserError
from ge_torchrl.report import canvas
from ge_torchrl.report.canvas import has_matplotlib, new_figure, save_figure


def test_without_matplotlib_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setattr(canvas, "find_spec", lambda _: None)
    assert not has_matplotlib()
    with pytest.raises(UserError, match=r'pip install -c constraints.txt -e ".\[plots\]"'):
        new_figure(1, 1)


def test_figures_need_no_pyplot_with_its_display_and_global_state(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    save_figure(new_figure(1, 1), tmp_path / "empty")


def test_a_very_wide_figure_has_fewer_dots_an_inch(tmp_path):
    _, png = save_figure(new_figure(600, 1), tmp_path / "wide")
    width = int.from_bytes(png.read_bytes()[16:20], "big")
    assert width == 20_000
