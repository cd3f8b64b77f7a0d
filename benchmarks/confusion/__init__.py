"""Data with a hidden effect, and how well `mrwarp diagnose` finds it (``python -m benchmarks.confusion --help``)."""

from benchmarks.confusion.case import Case, make_case, write_case

__all__ = ["Case", "make_case", "write_case"]
