"""``python -m paper table4``: a table or figure of the paper; ``python -m paper study train``: its policies."""

import sys

from mrwarp.cli import main

if __name__ == "__main__":
    words = sys.argv[1:]
    sys.exit(main(words) if words[:1] == ["study"] else main(["reproduce", *words], prog="python -m paper"))
