"""What several tests of the search start from."""

import pytest
from problems_for_tests import cartpole


@pytest.fixture(scope="module")
def opened():
    backend = cartpole()
    yield backend
    backend.close()
