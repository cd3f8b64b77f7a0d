"""Two bodies of 1 kg, 0.6 m from each other, welded: the inertia about the centre of both is 0.02 + 2·0.3² = 0.2."""

import newton
import numpy as np
import warp as wp

own = wp.mat33(0.01, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.01)
builder = newton.ModelBuilder()
near, far = (builder.add_link(mass=1.0, inertia=own, lock_inertia=True) for _ in range(2))
free = builder.add_joint_free(near)
weld = builder.add_joint_fixed(near, far, parent_xform=wp.transform((0.6, 0.0, 0.0), wp.quat_identity()))
builder.add_articulation([free, weld])
builder.collapse_fixed_joints()
print(f"I_yy = {np.array(builder.body_inertia[0]).reshape(3, 3)[1, 1]:.3f} kg·m², right is 0.200")
