"""Learned torque models as plain torch modules; nothing here knows a simulator."""
