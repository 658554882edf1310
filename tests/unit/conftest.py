"""What several tests of reports begin with."""

import pytest
import report_contexts


@pytest.fixture(scope="session")
def context():
    """A small arm with its model and logs."""
    return report_contexts.small()
