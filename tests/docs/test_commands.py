"""Every command, setting and file that the documentation names is there."""

import re
import shutil
import tomllib

import pytest
from command_line_for_tests import check_composes
from pages_for_tests import (
    OF_AN_EARLIER_VERSION,
    PAGES,
    ROOT,
    TODAYS_PAGES,
    blocks,
    commands,
    inline_codes,
    links,
    unknown_commands,
)

import ge_torchrl
from ge_torchrl import __main__ as command_line
from ge_torchrl.artefacts import controllers, jobs
from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.cli import RUN, VERBS
from ge_torchrl.cli.choices import with_environment
from ge_torchrl.config import check_key
from ge_torchrl.config.composing import compose
from ge_torchrl.errors import UserError
from ge_torchrl.report import pages, reading, runs
from ge_torchrl.run import starting_file, surveying
from ge_torchrl.tuning import study

SECTIONS = ("env", "grammar", "ge", "evaluation", "refiner", "polish", "archive")
KEY = re.compile(rf"(?:{'|'.join(SECTIONS)})\.[a-z_.]+")
OVERRIDES = re.compile(r"[a-z_.]+=[^ |*]+(?: [a-z_.]+=[^ |*]+)*")
PATH = re.compile(r"(?:docs|tests|conf|notebooks|ge_torchrl)/[\w./-]+")

COMMANDS = [command for path in TODAYS_PAGES for command in commands(path)]
OURS = sorted({command.arguments for command in COMMANDS if command.arguments is not None})
ids = " ".join


def page_id(path):
    return path.stem


@pytest.fixture
def finished_run(tmp_path):
    """The run whose configuration a command takes, where it looks for it."""
    RunFolder.create(tmp_path / "RUN", compose("cartpole", {}, {}))


@pytest.fixture
def own_environment(tmp_path):
    """The file of the page's own environment, where its command looks for it."""
    (tmp_path / "my_conf" / "env").mkdir(parents=True)
    (text,) = blocks(ROOT / "docs" / "your_own_environment.md", "yaml")
    (tmp_path / "my_conf" / "env" / "pendulum_switch.yaml").write_text(text)


@pytest.fixture
def tuned_preset(tmp_path):
    """The preset that a page tells of, where its commands look for it."""
    (tmp_path / "tuning" / "mountaincar" / "experiment").mkdir(parents=True)
    preset = "tuned_mountaincar.yaml"
    shutil.copy(
        ROOT / "docs" / "examples" / preset, tmp_path / "tuning" / "mountaincar" / "experiment" / preset
    )


@pytest.mark.parametrize("path", TODAYS_PAGES, ids=page_id)
def test_every_command_has_a_form_that_is_tested(path):
    assert unknown_commands(path) == []


@pytest.mark.parametrize(
    "text",
    [
        "```bash\npython -m ge_torchrl env=cartpole\n```\n",
        "```sh\nge_torchrl env=cartpole\n```\n",
        "```sh\ncc -o motor motor.c\n```\n",
        "```console\n$ ge-torchrl env=cartpole\n```\n",
        "* one\n\n  ```bash\n  ge-torchrl env=cartpole\n  ```\n",
        "~~~\nge-torchrl env=cartpole\n~~~\n",
        "Type python -m ge_torchrl env=cartpole into a shell.\n",
        "`cd docs && python -m ge_torchrl env=cartpole`\n",
        "    $ make run\n",
    ],
)
def test_a_form_that_no_test_knows_is_noticed(text, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(text)
    assert unknown_commands(page)


def test_the_pages_print_commands():
    assert len(OURS) > 30
    assert {arguments[0] for arguments in OURS} > set(VERBS)


@pytest.mark.usefixtures("experiment", "own_environment", "finished_run", "tuned_preset")
@pytest.mark.parametrize("arguments", [words for words in OURS if words[0] not in VERBS], ids=ids)
def test_a_run_that_is_printed_composes(arguments, tmp_path):
    arguments = arguments[1:] if arguments[0] == RUN else arguments
    # One seed composes as a hundred do, a hundred times as fast.
    few = [re.sub(r"range\((\d+),\d+\)", r"\1", word) for word in arguments]
    few = [word.replace("NAME", "cartpole").replace("$PWD", str(tmp_path)) for word in few]
    check_composes(with_environment(few))


@pytest.mark.parametrize("arguments", [words for words in OURS if words[0] in VERBS], ids=ids)
def test_a_verb_that_is_printed_takes_its_arguments(arguments, experiment, monkeypatch, capsys):
    def stop(*_):
        raise UserError("the arguments were read")

    for room, name in (
        (runs, "gather_runs"),
        (pages, "gather_runs"),
        (reading, "read_tree"),
        (surveying, "survey"),
        (controllers, "named_controller"),
        (starting_file, "write_starting_file"),
        (experiment, "resume"),
        (jobs, "find_sweeps"),
        (study, "check_keys"),
    ):
        monkeypatch.setattr(room, name, stop)
    status = command_line.main(arguments)
    if arguments[0] in ("completion", "explain"):
        assert status == 0
        return
    assert experiment.evaluated or (status == 2 and "the arguments were read" in capsys.readouterr().err)
    for word in arguments:
        if word.startswith("docs/"):
            assert (ROOT / word.partition(":")[0]).is_file(), word


def test_programs_that_are_called_are_there():
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE))
    for page, words in COMMANDS:
        if words[0] == "make":
            assert words[1] in targets, f"{page}: make {words[1]}"
        elif words[0] == "python" and words[1] != "-m":
            assert (ROOT / words[1]).is_file(), f"{page}: {words[1]}"
        elif words[0] == "source":
            assert words == ("source", ".venv/bin/activate"), page


def test_extras_that_are_named_are_there():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    installs = [words for _, words in COMMANDS if words[0].endswith("pip")]
    assert installs
    for words in installs:
        named = re.fullmatch(r"\.\[([a-z0-9,]+)\]", words[-1])[1].split(",")
        assert set(named) <= extras.keys(), words
        assert words[-2] == "-e", words
        assert words[1:-2] in (("install",), ("install", "-c", "constraints.txt")), words


@pytest.mark.parametrize("path", TODAYS_PAGES, ids=page_id)
def test_settings_that_are_named_are_there(path):
    for code in inline_codes(path):
        if not (key := KEY.match(code)) or code.startswith("archive.jsonl"):
            continue
        # A name of the library looks like a setting of the section that is called as it is imported.
        if key[0].removeprefix("ge.") not in ge_torchrl.__all__:
            check_key(key[0])


@pytest.mark.usefixtures("experiment")
@pytest.mark.parametrize(
    "overrides",
    sorted({code for path in TODAYS_PAGES for code in inline_codes(path) if OVERRIDES.fullmatch(code)}),
)
def test_values_that_are_named_compose(overrides):
    check_composes([word.replace("'", "") for word in overrides.split()])


@pytest.mark.parametrize("path", PAGES, ids=page_id)
def test_links_lead_somewhere(path):
    for target in links(path):
        assert (path.parent / target).exists(), target


@pytest.mark.parametrize("path", TODAYS_PAGES, ids=page_id)
def test_files_that_are_named_are_there(path):
    for code in inline_codes(path):
        if PATH.fullmatch(code):
            assert (ROOT / code.replace("NAME", "cartpole")).exists(), code


def test_the_page_of_an_earlier_version_says_so_first():
    lines = OF_AN_EARLIER_VERSION.read_text().splitlines()
    assert re.search(r"former versions of the program, up to commit `[0-9a-f]{7}`", lines[2])
