"""kernels of mrwarp; see the README's map. Who loads one gets none of Warp's notes on what it finds and compiles."""

from mrwarp.runtime import quiet_warp

quiet_warp()
