"""No module of the package can run what it reads: none unpickles, evaluates or makes objects by names in a file."""

import ast
from pathlib import Path

import pytest

import ge_torchrl

PACKAGE = Path(ge_torchrl.__file__).parent
# What each may do, by name: unpickle, evaluate a text, run a file, or make objects that a file names.
FORBIDDEN = {
    "cloudpickle", "dill", "joblib", "jsonpickle", "marshal", "pickle", "runpy", "shelve",
    "eval", "exec", "exec_module", "__import__",
    "torch.load", "allow_pickle", "instantiate", "full_load", "unsafe_load", "FullLoader", "UnsafeLoader",
}  # fmt: skip
REASONS = {
    "environments/sending.py": {"pickle": "between a process and those that it started; no file holds it"},
    "environments/plants/file.py": {
        "exec_module": "a plant is a Python file of the user's own; else --trust"
    },
    "environments/plants/kernel.py": {"exec_module": "the package's own kernels, once more for a plant"},
    "exports/modules.py": {"exec_module": "what was exported a moment ago is tried before it is written"},
}


def found_in(source):
    """What a module does that could run what it reads."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (name.name.partition(".")[0] for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield from ((node.module or "").partition(".")[0], *(name.name for name in node.names))
        elif isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.Attribute):
            is_torchs = isinstance(node.value, ast.Name) and node.value.id == "torch" and node.attr == "load"
            yield "torch.load" if is_torchs else node.attr
        elif isinstance(node, ast.keyword) and node.arg == "allow_pickle":
            yield "allow_pickle" if ast.unparse(node.value) != "False" else ""


def forbidden(source):
    return FORBIDDEN.intersection(found_in(source))


def test_the_package_runs_nothing_that_it_reads():
    found = {
        path.relative_to(PACKAGE).as_posix(): names
        for path in PACKAGE.rglob("*.py")
        if (names := forbidden(path.read_text()))
    }
    assert found == {path: set(reasons) for path, reasons in REASONS.items()}


@pytest.mark.parametrize(
    "source",
    [
        "import pickle", "from pickle import loads", "import marshal as m", "from shelve import open as o",
        "eval(text)", "exec(code)", "torch.load(path)", "hydra.utils.instantiate(node)",
        "from hydra.utils import instantiate", "yaml.load(text, yaml.FullLoader)", "np.load(path, allow_pickle=True)",
        "builtins.eval(text)", "yaml.unsafe_load(text)", "import joblib",
    ],
)  # fmt: skip
def test_each_way_would_be_seen(source):
    assert forbidden(source)
