"""Train the walking policy: ``python train/ppo.py --device cpu --num-envs 64``."""

import sys

from mrwarp.commands.run_train import main

if __name__ == "__main__":
    sys.exit(main(prog="train/ppo.py"))
