"""What all worker processes need, loaded once by the server from which ``execute.forks`` forks them."""

import gc
import signal
from contextlib import suppress

signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that started the server
with suppress(Exception):  # the workers try again, and report why it fails
    import vlafuzz.sim.maniskill.evaluator  # noqa: F401

gc.freeze()  # a collection would write to the pages that all workers share
