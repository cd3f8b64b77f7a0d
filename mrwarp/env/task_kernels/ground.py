"""The ground of a height field below the trunk and the feet."""

import warp as wp

from mrwarp.env.task_kernels.gait import foot_point


@wp.func
def grid_place(x: float, half: float, cell: float, points: int) -> float:
    """Place of a coordinate on a grid's axis, in cells, kept inside the grid; 0 for NaN."""
    place = (x + half) / cell
    return wp.where(place >= 0.0, wp.min(place, float(points) - 1.001), 0.0)


@wp.func
def ground_height(heights: wp.array2d[float], cell: float, x: float, y: float) -> float:
    """Height of the ground at a point of the world [m]; beyond the field, and for NaN, that of its edge.

    The field is centred, rows run along y. Each cell is the two triangles that MuJoCo makes of it: split from its
    least to its greatest corner.
    """
    rows, columns = heights.shape[0], heights.shape[1]
    u = grid_place(x, 0.5 * cell * float(columns - 1), cell, columns)
    v = grid_place(y, 0.5 * cell * float(rows - 1), cell, rows)
    column, row = int(u), int(v)
    u -= float(column)
    v -= float(row)
    here, right = heights[row, column], heights[row, column + 1]
    above, beyond = heights[row + 1, column], heights[row + 1, column + 1]
    if u >= v:
        return here + u * (right - here) + v * (beyond - right)
    return here + v * (above - here) + u * (beyond - above)


@wp.kernel
def ground_kernel(
    # parameters: heights [m], shape (rows, columns); their spacing [m]
    heights: wp.array2d[float],
    cell: float,
    # in, shapes (E,), (E, 3) [m], (E, 4), (E, J) [rad]
    mask_in: wp.array[wp.bool],
    root_pos_in: wp.array2d[float],
    root_quat_in: wp.array2d[float],
    q_in: wp.array2d[float],
    # out, shapes (E,), (E, 4) [m]
    ground_out: wp.array[float],
    foot_ground_out: wp.array2d[float],
):
    """Height of the ground below the trunk and below each foot."""
    env = wp.tid()
    if not mask_in[env]:
        return
    x, y = root_pos_in[env, 0], root_pos_in[env, 1]
    ground_out[env] = ground_height(heights, cell, x, y)
    # Warp's quaternions end with the real part
    turn = wp.quat(root_quat_in[env, 1], root_quat_in[env, 2], root_quat_in[env, 3], root_quat_in[env, 0])
    for leg in range(4):
        foot = wp.quat_rotate(turn, foot_point(leg, q_in[env, 3 * leg], q_in[env, 3 * leg + 1], q_in[env, 3 * leg + 2]))
        foot_ground_out[env, leg] = ground_height(heights, cell, x + foot[0], y + foot[1])
