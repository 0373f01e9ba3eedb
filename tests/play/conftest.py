"""What all tests of this room need."""

import pytest

pytest.importorskip("PIL")
