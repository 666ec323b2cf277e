"""Ctrl-C works in the tests, and in the programs that they start, however pytest was started."""

import signal

signal.signal(signal.SIGINT, signal.default_int_handler)
