"""Causes of a robot's wrong simulation: one declaration each, listed once in ``robot_causes``."""
