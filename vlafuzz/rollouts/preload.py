"""What all worker processes need, loaded once by the server from which ``rollouts.forks`` forks them."""

import gc
import signal
from contextlib import suppress

from vlafuzz.worlds import known_worlds

signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that started the server
with suppress(Exception):  # the workers try again, and report why it fails
    next(iter(known_worlds().values())).preload()

gc.freeze()  # a collection would write to the pages that all workers share
