"""Commands of ``mrwarp``: the options of each as a dataclass, and its work, for which it loads an engine."""
