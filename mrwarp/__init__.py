"""mrwarp: a batched simulator of legged robots whose joints carry magnetorheological actuators."""
