"""Commands of ``python -m paper``: the options of each as a dataclass, and its work."""
