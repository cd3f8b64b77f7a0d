"""The MR joint in simulators of others, each in an environment of its own."""
