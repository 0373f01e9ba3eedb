"""What tests of whole runs start from."""

import pytest
from problems_for_tests import Noting

from ge_torchrl.run import experiment


@pytest.fixture
def opened(monkeypatch):
    """Let what a run opens be a backend that counts by itself; gives the list of them."""
    backends, open_backend = [], experiment.open_backend

    def noting(*args):
        backends.append(Noting(open_backend(*args)))
        return backends[-1]

    monkeypatch.setattr(experiment, "open_backend", noting)
    return backends
