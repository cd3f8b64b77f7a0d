"""What does the simulation get wrong, and why: ``mrwarp diagnose``, and in Python ``mrwarp.diagnose(...)``."""

import sys
from types import ModuleType

from mrwarp.diagnose.pipeline import diagnose
from mrwarp.diagnose.report.in_python import Found, diagnose_files
from mrwarp.diagnose.result import Diagnosis

__all__ = ["Diagnosis", "Found", "diagnose"]


class _Callable(ModuleType):
    """The package is the public function too, for ``mrwarp.diagnose`` names both."""

    __call__ = staticmethod(diagnose_files)


sys.modules[__name__].__class__ = _Callable
