"""The page of the command line says what the program does."""

import re

from pages_for_tests import ROOT

from ge_torchrl.__main__ import main
from ge_torchrl.cli import HELP, RUN, VERBS, statuses
from ge_torchrl.cli.completing import SCRIPTS

PAGE = (ROOT / "docs" / "command_line.md").read_text(encoding="utf-8")


def rows(head):
    """The first cell of each row of a table."""
    table = PAGE.split(head, 1)[1].split("\n\n", 1)[0].splitlines()[2:]
    return [re.sub(r"[`|]", "", line.split("| ")[1]).strip() for line in table]


def test_every_command_stands_in_the_table():
    assert sorted(rows("| command | what it does |")) == sorted({*VERBS, RUN, HELP})


def test_every_exit_status_stands_in_the_table():
    known = {value for name, value in vars(statuses).items() if name.isupper()}
    assert {int(status) for status in rows("| status | meaning |")} == known


def test_every_shell_stands_in_the_table():
    assert rows("| shell | line | file |") == sorted(SCRIPTS, key=list(SCRIPTS).index)


def test_what_explain_prints_is_what_it_prints(capsys):
    shown = PAGE.split("```\nge.generations\n", 1)[1].split("```", 1)[0].splitlines()
    assert main(["explain", "ge.generations"]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert all(line in printed for line in shown if line.strip() != "...")
