"""A thousand joints in NumPy: the loops of the paper's device at four currents. Needs no simulator.

Run: ``python examples/joint_batch.py`` writes ``runs/loops.png``.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import mrwarp
from mrwarp.runtime import quiet_libraries

DT = 0.005


def main(out: Path = Path("runs/loops.png")) -> None:
    """Swing all joints through a sine of 0.4 rad and 1 Hz, each with its own current, and draw four loops."""
    num = 1000
    joints = mrwarp.JointBatch(num=num, dt=DT)  # the paper's device; or mrwarp.load_model("model.json")
    current = np.linspace(0.0, 1.5, num)
    torques, angles = [], []
    for k in range(400):
        phase = 2.0 * np.pi * k * DT
        q, qd = np.full(num, 0.4 * np.sin(phase)), np.full(num, 0.8 * np.pi * np.cos(phase))
        torques.append(joints.step(q, qd, current))  # positive against positive motion, as a bench logs it
        angles.append(q[0])
    torque = np.array(torques[200:])  # the second period
    lost = (torque * np.gradient(np.array(angles[200:]))[:, None]).sum(axis=0)
    print(f"energy per cycle: {lost[0]:.2f} J without current, {lost[-1]:.2f} J at 1.5 A")

    out.parent.mkdir(parents=True, exist_ok=True)
    for k in (0, 333, 666, 999):
        plt.plot(angles[200:], torque[:, k], label=f"{current[k]:.1f} A")
    plt.xlabel("angle [rad]")
    plt.ylabel("torque [N·m]")
    plt.title("Torque of eq. 14 over a sine of 1 Hz")
    plt.legend()
    plt.savefig(out, dpi=150)
    plt.close()
    print(f"picture: {out}")


if __name__ == "__main__":
    quiet_libraries(gpu=False, networks=False)
    main()
