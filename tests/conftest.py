"""What every test starts from."""

from collections.abc import Iterator

import pytest
import structlog

from followerd.pytest_plugin import simulation

__all__ = ["simulation"]


@pytest.fixture(autouse=True)
def _fresh_logging() -> Iterator[None]:
    """No test inherits another's log configuration."""
    structlog.reset_defaults()
    yield
    structlog.reset_defaults()
