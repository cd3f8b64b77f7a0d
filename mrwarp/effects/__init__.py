"""Effects beyond eqs. 14 and 15: small laws that can be put into the path of the joint (see ``catalogue``)."""
