"""What is told of a worker process that ended by itself."""

from __future__ import annotations

import sys

from ge_torchrl.errors import EnvironmentFaultError


def worker_died(environment_id: str) -> EnvironmentFaultError:
    """Return the error of a worker process that ended by itself."""
    main = sys.modules["__main__"]
    is_script = getattr(main, "__file__", None) is not None and getattr(main, "__spec__", None) is None
    script = (
        '; a script needs its calls below if __name__ == "__main__":, since workers read it too' * is_script
    )
    return EnvironmentFaultError(
        f"a worker process of env.id={environment_id} died; env.workers=1 runs the environment in this process, "
        f"where its last words can be read{script}"
    )
