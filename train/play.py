"""Watch a policy walk: ``python train/play.py --policy runs/walk/policy.onnx``."""

import sys

from mrwarp.commands.run_play import main

if __name__ == "__main__":
    sys.exit(main(prog="train/play.py"))
