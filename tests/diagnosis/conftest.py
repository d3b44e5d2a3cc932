"""Innovations of a filter that is right."""

import numpy as np
import pytest
from diagnosis.made import M, S, T


@pytest.fixture(scope="session")
def white():
    return np.random.default_rng(0).multivariate_normal(np.zeros(M), S, T)
