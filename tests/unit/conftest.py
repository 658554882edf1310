"""What several tests begin with."""

import shutil

import pandas as pd
import pendulum_sample
import pytest
import report_contexts

import pumaid


@pytest.fixture(scope="session")
def context():
    """A small arm with its model and logs."""
    return report_contexts.small()


@pytest.fixture(scope="session")
def from_csv(tmp_path_factory):
    """The pendulum's table, and what is identified from it as CSV, without the plan beside it."""
    folder = tmp_path_factory.mktemp("csv")
    path = shutil.copy(pendulum_sample.ARM / "logs" / "session_01.csv", folder)
    pendulum_sample.robot(folder)
    return pd.read_csv(path), pumaid.identify(folder)
