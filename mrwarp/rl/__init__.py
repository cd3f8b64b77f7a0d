"""Training by PPO, policies and their files, and the walking task in gymnasium."""

from __future__ import annotations

WALK = "mrwarp/MrGoWalk-v0"
"""Name of the walking task in gymnasium."""


def register_walk() -> None:
    """Make the walking task known to gymnasium, single and vectorised; nothing is loaded before it is made."""
    import gymnasium

    if WALK not in gymnasium.registry:
        place = "mrwarp.rl.gymnasium_env"
        gymnasium.register(WALK, entry_point=f"{place}:MrGoWalk", vector_entry_point=f"{place}:make_walks")
