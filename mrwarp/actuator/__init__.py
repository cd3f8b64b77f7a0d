"""The MR actuator of a simulated joint, and what carries it into the engines."""
