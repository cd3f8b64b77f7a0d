"""Shared by the tests of diagnoses."""

from collections.abc import Iterator

import pytest

from mrwarp.identify import boosting


@pytest.fixture(scope="module")
def few_trees() -> Iterator[None]:
    """Boosting takes a third of its trees, each three times as large a step: growing 150 takes a second or more."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(boosting, "_SETTINGS", {**boosting._SETTINGS, "max_iter": 50, "learning_rate": 0.3})
        yield
