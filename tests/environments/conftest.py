import pytest
from environments_for_tests import register

from ge_torchrl.environments.gymnasium_backend import GymnasiumBackend
from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.spec import describe


@pytest.fixture
def opened():
    """Open backends that are closed at the end."""
    backends = []

    def open_one(environment_id, threads=1, **described):
        backends.append(KernelBackend(describe(environment_id, **described), threads))
        return backends[-1]

    yield open_one
    for backend in backends:
        backend.close()


@pytest.fixture
def open_gymnasium():
    """Open Gymnasium backends, of descriptions or classes, that are closed at the end."""
    backends = []

    def open_one(described, workers=1):
        if isinstance(described, type):
            described = describe(register(described))
        backends.append(GymnasiumBackend(described, workers))
        return backends[-1]

    yield open_one
    for backend in backends:
        backend.close()
