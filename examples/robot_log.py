"""A robot's log: record an arm whose lower link is heavier than its file says, and let the log say so.

Run: ``python examples/robot_log.py`` (a minute). For a log of your own: ``mrwarp diagnose robot LOG``.
"""

from pathlib import Path

from mrwarp.robot_logs.robot_diagnosis import diagnose_log
from mrwarp.robot_logs.robot_log import load_log
from mrwarp.robot_logs.virtual.record_log import LogCfg, record
from mrwarp.runtime import quiet_libraries

ARM = """
<mujoco model="arm">
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="upper" pos="0 0 0.5">
      <joint name="shoulder" axis="0 1 0" damping="0.02" frictionloss="0.1" armature="0.005"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.25" mass="0.8"/>
      <body name="lower" pos="0 0 -0.25">
        <joint name="elbow" axis="0 1 0" damping="0.02" frictionloss="0.1" armature="0.005"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.25" mass="0.5"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def main(out: Path = Path("runs/example-log"), seconds: float = 10.0) -> None:
    """Record two motions with 0.15 kg hidden in the lower link, and print what the diagnosis names."""
    out.mkdir(parents=True, exist_ok=True)
    robot = out / "arm.xml"
    robot.write_text(ARM)
    cfg = LogCfg(robot=str(robot), motions=(("chirp", seconds), ("steps", seconds)), hide=("link_mass=lower:0.15",))
    record(cfg, out / "log")

    found = diagnose_log(robot, load_log(out / "log"))
    print(found.sentence)
    for cause in found.causes:
        for name, number in cause.parameters.items():
            low, high = number.ci95
            print(f"{cause.name} of {cause.where}: {name} {number.value:.3g} {number.unit} ({low:.3g} to {high:.3g})")


if __name__ == "__main__":
    quiet_libraries(gpu=False)
    main()
