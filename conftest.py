"""What all tests of the workspace need, those of the packages as well."""

from collections.abc import Iterator
import sys

import pytest


@pytest.fixture(autouse=True)
def _turns_of_threads() -> Iterator[None]:
    """Keep what a machine's threads want of the interpreter from the tests after them."""
    interval = sys.getswitchinterval()
    yield
    sys.setswitchinterval(interval)
