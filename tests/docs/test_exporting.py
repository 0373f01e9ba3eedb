"""The pages on exports print what their commands print."""

import re
import shlex

import pytest
from pages_for_tests import ROOT

from ge_torchrl.__main__ import main
from ge_torchrl.exports.formats import FORMATS

PAGES = [ROOT / "docs" / name for name in ("exporting.md", "microcontroller.md", "plc.md")]
TEXT = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
# The last command of a block, and the block that follows it.
SHOWN = dict(
    re.findall(
        r"^(python -m ge_torchrl export [^\n]*)\n```\n\n```\w*\n(.*?)^```",
        TEXT,
        flags=re.DOTALL | re.MULTILINE,
    )
)


@pytest.fixture
def beside_docs(tmp_path, monkeypatch):
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("beside_docs")
@pytest.mark.parametrize("command", SHOWN)
def test_the_page_shows_what_its_command_prints(command, capsys):
    assert main(shlex.split(command)[3:]) == 0
    assert capsys.readouterr().out == SHOWN[command]


def test_every_format_is_on_the_page():
    assert all(f"--to {to}" in TEXT or f"`{to}`" in TEXT for to in FORMATS)
    assert len(SHOWN) >= 8


@pytest.mark.usefixtures("beside_docs")
def test_the_picture_is_what_its_command_makes(tmp_path):
    tree, picture = "docs/trees/cartpole_two_decisions.json", tmp_path / "picture.svg"
    assert main(["export", tree, "--to", "svg", "--out", str(picture)]) == 0
    assert picture.read_bytes() == (ROOT / "docs" / "figures" / "cartpole_two_decisions.svg").read_bytes()
