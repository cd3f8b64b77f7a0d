"""Train the walking policy: ``python train/ppo.py --device cpu --num-envs 64``."""

import sys

from mrwarp.cli import main

if __name__ == "__main__":
    sys.exit(main(["train", *sys.argv[1:]], prog="train/ppo.py"))
