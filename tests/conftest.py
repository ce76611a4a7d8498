"""What holds for every test."""

import signal

# Whoever runs the tests in the background of a script ignores SIGINT, and so would every process
# that a test starts; some tests interrupt theirs.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
