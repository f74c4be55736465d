"""Values of parameters with which a test says what it has said with others."""

import pytest


def rarely(*values):
    """Such values, for `make test-longest` alone."""
    return [pytest.param(value, marks=pytest.mark.longest) for value in values]
