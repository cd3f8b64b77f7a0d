"""Impact trials, live: ``python viz/impact.py --live`` is ``mrwarp impact --live``."""

import sys

from mrwarp.cli import main

if __name__ == "__main__":
    sys.exit(main(["impact", *sys.argv[1:]]))
