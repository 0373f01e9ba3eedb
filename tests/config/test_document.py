"""The page of all settings."""

from pathlib import Path

from ge_torchrl.config import template
from ge_torchrl.config.document import settings_page

PAGE = Path(__file__).parents[2] / "docs" / "settings.md"


def flat(values, prefix=""):
    for name, value in values.items():
        if value and isinstance(value, dict):
            yield from flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name


def test_the_page_is_up_to_date():
    assert PAGE.read_text(encoding="utf-8") == settings_page(), "type: make settings"


def test_the_page_has_a_row_for_every_key():
    page = settings_page()
    rows = [line.split("`")[1] for line in page.splitlines() if line.startswith("| `")]
    assert sorted(rows) == sorted(flat(template()))
    assert all(line.count("|") == 5 for line in page.splitlines() if line.startswith("| `"))
