"""Impact trials, live: ``python viz/impact.py --live`` is ``mrwarp impact --live``."""

import sys

from mrwarp.commands.run_impact import main

if __name__ == "__main__":
    sys.exit(main())
