"""``python -m vlafuzz`` and the command ``vlafuzz``."""

import sys

from vlafuzz.cli import main

if __name__ == "__main__":
    sys.exit(main())
