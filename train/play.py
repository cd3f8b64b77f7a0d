"""Watch a policy walk: ``python train/play.py --policy runs/walk/policy.onnx``."""

import sys

from mrwarp.cli import main

if __name__ == "__main__":
    sys.exit(main(["play", *sys.argv[1:]], prog="train/play.py"))
