"""``python -m mrwarp`` is ``mrwarp``."""

import sys

from mrwarp.cli import main

sys.exit(main())
