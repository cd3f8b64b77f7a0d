"""Command lines: how options are read, and which commands there are; loads no engine."""
