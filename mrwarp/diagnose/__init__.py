"""What does the simulation get wrong, and why: ``mrwarp diagnose``."""

from mrwarp.diagnose.pipeline import diagnose
from mrwarp.diagnose.result import Diagnosis

__all__ = ["Diagnosis", "diagnose"]
