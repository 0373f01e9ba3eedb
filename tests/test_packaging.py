"""The wheel is the whole program: installed alone, it runs. And what is said of the package is true."""

import os
import re
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile

import pytest
import yaml
from pages_for_tests import ROOT

from ge_torchrl import __version__

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel, built by the declared backend, without a network."""
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (built,) = folder.glob("*.whl")
    return built


def test_the_wheel_holds_every_module_the_configuration_and_the_types(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    for path in (ROOT / "ge_torchrl").rglob("*"):
        if path.is_file() and "__pycache__" not in path.parts:
            assert path.relative_to(ROOT).as_posix() in names
    for path in (ROOT / "conf").rglob("*.yaml"):
        assert f"ge_torchrl/{path.relative_to(ROOT).as_posix()}" in names
    assert "ge_torchrl/py.typed" in names
    assert not any(name.startswith(("tests/", "conf/")) for name in names)


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """The folder of programs of a new environment with the wheel in it; what the wheel needs is that of this one."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, symlinks=True)
    python = folder / "bin" / "python"
    install = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        str(python),
        "install",
        "--quiet",
        "--no-deps",
        "--no-index",
    ]
    subprocess.run([*install, "--disable-pip-version-check", str(wheel)], check=True)
    paths = sysconfig.get_paths("venv", vars={"base": str(folder), "installed_base": str(folder)})
    (folder / paths["purelib"]).joinpath("needed.pth").write_text(f"{sysconfig.get_path('purelib')}\n")
    return folder / "bin"


@pytest.mark.skipif(os.name != "posix", reason="the folders of a virtual environment are POSIX ones")
@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--version"], f"ge_torchrl {__version__}"),
        (["run", "env=acrobot", "--cfg", "job"], "id: Acrobot-v1"),
        (["explain", "ge.generations"], "set by    env=acrobot"),
        (["completion", "words", "env=cartp"], "env=cartpole"),
    ],
)
def test_the_program_runs_from_the_wheel_alone(installed, tmp_path, arguments, told):
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [installed / "ge-torchrl", *arguments],
        cwd=tmp_path,
        env=clean,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert told in done.stdout
    where = "import ge_torchrl; print(ge_torchrl.__file__)"
    done = subprocess.run(
        [installed / "python", "-c", where],
        cwd=tmp_path,
        env=clean,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.startswith(str(installed.parent))


def test_the_version_is_the_same_everywhere():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert PROJECT["version"] == __version__ == citation["version"]
    assert re.findall(r"^## \[([^\]]+)\]", changes, flags=re.MULTILINE)[:2] == ["Unreleased", __version__]
    assert citation["authors"] == PROJECT["authors"]
    assert citation["license"] == PROJECT["license"]


def test_the_changelog_has_the_form_that_it_names():
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    kinds = set(re.findall(r"^### (\w+)$", changes, flags=re.MULTILINE))
    assert kinds <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
    assert all(re.fullmatch(r"## \[(Unreleased|[\d.]+\] - \d{4}-\d\d-\d\d)\]?", line)
               for line in changes.splitlines() if line.startswith("## "))  # fmt: skip


def test_every_dependency_is_bounded_below_and_above():
    extras = PROJECT["optional-dependencies"].values()
    for needed in (*PROJECT["dependencies"], *(one for extra in extras for one in extra)):
        if not needed.startswith("ge-torchrl["):
            assert ">=" in needed, needed
            assert ",<" in needed, needed
