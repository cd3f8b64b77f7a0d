"""Effects beyond eqs. 14 and 15: small laws that can be put into the path of the joint (see ``catalogue``).

Whoever loads one, as a model does, gets none of Warp's notes on what it finds and compiles.
"""

from mrwarp.runtime import quiet_warp

quiet_warp()
