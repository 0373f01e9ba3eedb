"""Running the Python that an export has written."""

from __future__ import annotations

import importlib.util
import tempfile
from pathlib import Path
from types import ModuleType


def loaded(content: bytes) -> ModuleType:
    """Return the module that a text makes, as `import` would from a file.

    Args:
        content: Python, in UTF-8.

    Raises:
        SyntaxError: It is no Python.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "exported.py"
        path.write_bytes(content)
        spec = importlib.util.spec_from_file_location("exported", path)
        if spec is None or spec.loader is None:
            raise ImportError(f"{path} is no module")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    return module
