"""Loaders on mutated files; many more of them: ``python tools/fuzz.py``."""

import sys
from pathlib import Path

import hypothesis
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))

from targets import targets  # noqa: E402

TARGETS = targets()


@pytest.mark.parametrize("target", TARGETS, ids=[t.name for t in TARGETS])
def test_any_file_is_taken_or_refused_in_a_sentence(target):
    accepted = []

    @hypothesis.settings(
        max_examples=100,
        deadline=None,
        suppress_health_check=list(hypothesis.HealthCheck),
    )
    @hypothesis.given(data=target.inputs)
    def check(data):
        accepted.append(target.run(data))

    check()
    # Both ways are gone: the seeds are good files and the mutations reach the checks.
    assert True in accepted and False in accepted
