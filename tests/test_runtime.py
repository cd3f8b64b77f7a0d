"""Shared parts of commands: what people read has four digits."""

import pytest

from mrwarp.runtime import four_digits


@pytest.mark.parametrize(
    ("note", "shown"),
    [
        (
            "lag: time_constant = 0.01488980216119077 s, 95 % interval 0.014697045533804666 to 0.015085086855685043",
            "lag: time_constant = 0.01489 s, 95 % interval 0.0147 to 0.01509",
        ),
        ("bends by -1.23456e-07 rad", "bends by -1.235e-07 rad"),
        ("12.5 N·m at 1.5 A, 15.7 N·m", "12.5 N·m at 1.5 A, 15.7 N·m"),
        ("runs/walk-0.12345/policy.onnx, mrwarp 1.2.3456", "runs/walk-0.12345/policy.onnx, mrwarp 1.2.3456"),
    ],
)
def test_a_note_has_four_digits(note: str, shown: str) -> None:
    """Names of files and versions stay."""
    assert four_digits(note) == shown
