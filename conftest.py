"""What all tests of the workspace need, those of the packages as well."""

from collections.abc import Iterator
import sys

from hypothesis import HealthCheck, settings
import pytest

# The same examples whichever tests are run, and no failure because a machine is slow.
settings.register_profile(
    'checkweigher',
    derandomize=True,
    deadline=None,
    database=None,
    max_examples=50,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile('checkweigher')


@pytest.fixture(autouse=True)
def _turns_of_threads() -> Iterator[None]:
    """Keep what a machine's threads want of the interpreter from the tests after them."""
    interval = sys.getswitchinterval()
    yield
    sys.setswitchinterval(interval)
