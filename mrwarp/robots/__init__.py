"""Robots of others: read from MJCF, URDF or USD, understood as legs on a trunk, written as an asset."""
