"""Published hysteresis laws of semi-active devices that can stand in place of eq. 15, one per file."""
