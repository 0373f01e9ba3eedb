"""The page on microcontrollers: its commands are run, in their order, and print what it shows."""

import re
import shlex
import shutil
import subprocess
from contextlib import closing

import pytest
from exports_for_tests import needs_compiler
from pages_for_tests import ROOT, blocks

from ge_torchrl.__main__ import main
from ge_torchrl.environments.spec import describe, make_gymnasium
from ge_torchrl.run.closing import drawn
from ge_torchrl.trees.files import read_controller

PAGE = ROOT / "docs" / "microcontroller.md"
TEXT = PAGE.read_text(encoding="utf-8")
EXAMPLES = ROOT / "docs" / "examples"
LAW, CONSTANTS = (ROOT / "docs" / "trees" / f"motor_{name}.json" for name in ("law", "constants"))
# Each tree is exported, compiled and run by a block, and what it prints is the block behind.
TRIED = re.findall(r"^```sh\n([^`]*^\./motor)\n```\n\n```\n(.*?)^```", TEXT, flags=re.DOTALL | re.MULTILINE)


@pytest.fixture
def beside_docs(tmp_path, monkeypatch):
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    monkeypatch.chdir(tmp_path)


def run(lines):
    """Run the lines of a block; return what the last one prints."""
    for line in lines:
        words = shlex.split(line)
        if words[:3] == ["python", "-m", "ge_torchrl"]:
            assert main(words[3:]) == 0
            continue
        extra = ["-Wpedantic", "-Wconversion", "-Werror"] if words[0] == "cc" else []
        done = subprocess.run([*words, *extra], capture_output=True, text=True, check=True)
    return done.stdout


def test_the_page_prints_the_main_loop():
    assert (EXAMPLES / "motor_firmware.c").read_text() in blocks(PAGE, "c")


@pytest.mark.parametrize("path", [LAW, CONSTANTS], ids=["law", "constants"])
def test_the_page_draws_its_trees(path):
    assert drawn(read_controller(path)) + "\n" in blocks(PAGE, "")


@needs_compiler
@pytest.mark.usefixtures("beside_docs")
@pytest.mark.parametrize(("block", "shown"), TRIED, ids=["law", "constants"])
def test_the_firmware_runs_on_a_pc_as_the_page_shows(block, shown):
    assert run(block.splitlines()) == shown


@pytest.mark.usefixtures("beside_docs")
@pytest.mark.parametrize(("path", "number"), [(LAW, 0), (CONSTANTS, 1)], ids=["law", "constants"])
def test_the_simulation_on_a_pc_is_the_plant(path, number):
    shown = TRIED[number][1].splitlines()
    rows = [[float(text) for text in re.findall(r"-?\d+\.\d+", line)] for line in shown]
    controller = read_controller(path)
    with closing(make_gymnasium(describe(controller.names.id))) as environment:
        environment.reset(seed=0)
        environment.unwrapped.state = [0.0, 0.0, 100.0]
        observation = [100.0, 0.0, 0.0]
        for tick in range(1, 200):
            voltage = controller(observation)
            observation, *_ = environment.step(voltage)
            if tick % 20 == 0:
                expected = [tick * 0.01, observation[1], observation[2], voltage[0]]
                assert rows[tick // 20] == pytest.approx(expected, abs=0.0051)


def test_the_board_of_the_page_has_a_compiler(tmp_path, monkeypatch):
    lines = next(block for block in blocks(PAGE, "sh") if "arm-none-eabi-size" in block).splitlines()
    if shutil.which("arm-none-eabi-gcc") is None:
        pytest.skip("there is no compiler for Arm")
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(LAW), "--to", "c", "--out", "motor.c"]) == 0
    assert "motor.elf" in run(lines)
