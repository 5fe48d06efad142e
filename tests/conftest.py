"""What every test starts from."""

from collections.abc import Iterator

import pytest
import structlog
from hypothesis import settings

from followerd.pytest_plugin import simulation

__all__ = ["simulation"]

# the quick run stays under a minute; the slow fuzz jobs look at millions
settings.register_profile("quick", max_examples=40)
settings.load_profile("quick")


@pytest.fixture(autouse=True)
def _fresh_logging() -> Iterator[None]:
    """No test inherits another's log configuration."""
    structlog.reset_defaults()
    yield
    structlog.reset_defaults()
