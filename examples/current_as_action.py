"""Coil currents as actions: a policy commands its four brakes, one more action for each.

Run: ``python examples/current_as_action.py`` (``mrwarp train --current-by learned`` trains one)
"""

import torch

import mrwarp
from mrwarp.enums import CurrentCommand
from mrwarp.runtime import quiet_libraries


def main() -> None:
    """Stand for a second with the coils off, then with all the current: what the coils take and the motors bear."""
    env = mrwarp.WalkEnv(mrwarp.TaskCfg(num_envs=8, current_by=CurrentCommand.LEARNED, randomize=None))
    joints = 12
    print(f"{env.num_actions} actions: {joints} joint targets and {env.num_actions - joints} currents in [-1, 1]")
    for name, level in (("off", -1.0), ("full", 1.0)):
        env.restart()
        action = torch.zeros(8, env.num_actions)
        action[:, joints:] = level
        for _ in range(50):
            env.step(action)
        current = env.view(env.actuator.current).abs().mean().item()
        motor = env.view(env.actuator.tau_motor)[:, 2::3].abs().mean().item()
        print(f"coils {name}: {current:.2f} A, calf motors {motor:.2f} N·m")


if __name__ == "__main__":
    quiet_libraries(gpu=False)
    main()
