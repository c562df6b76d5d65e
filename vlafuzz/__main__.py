"""``python -m vlafuzz``."""

import sys

from vlafuzz.cli import main

sys.exit(main())
