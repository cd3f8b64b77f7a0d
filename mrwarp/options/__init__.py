"""Options of the commands; loads no engine."""
