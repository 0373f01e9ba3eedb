"""What several tests of the search start from."""

import pytest
from problems_for_tests import Noting, cartpole


@pytest.fixture(scope="module")
def opened():
    backend = cartpole()
    yield backend
    backend.close()


@pytest.fixture
def backend(opened):
    opened.limit = None
    yield Noting(opened)
    opened.limit = None
