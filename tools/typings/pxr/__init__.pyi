# OpenUSD's Python modules are C extensions without stubs: everything in them is Any to pyright.
from typing import Any

def __getattr__(name: str) -> Any: ...
