"""Run a program in a pseudo-terminal of COLUMNS x 24 and copy its output to stdout.

usage: in_terminal.py COLUMNS [--signal NAME AFTER_SECONDS COUNT] PROGRAM ARGUMENT...
"""

import fcntl, os, pty, select, signal, struct, sys, termios, time

columns, rest = int(sys.argv[1]), sys.argv[2:]
name, after, count = None, 0.0, 0
if rest[0] == "--signal":
    name, after, count, rest = rest[1], float(rest[2]), int(rest[3]), rest[4:]
child, terminal = pty.fork()
if child == 0:
    # The size is set before the program starts.
    fcntl.ioctl(0, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    os.execv(rest[0], rest)
due = time.monotonic() + after
while True:
    ready, _, _ = select.select([terminal], [], [], 0.05)
    if ready:
        try:
            data = os.read(terminal, 65536)
        except OSError:  # the program has ended
            break
        if not data:
            break
        sys.stdout.buffer.write(data)
        sys.stdout.buffer.flush()
    if count and time.monotonic() >= due:
        os.kill(child, getattr(signal, name))
        count, due = count - 1, time.monotonic() + 0.3
_, status = os.waitpid(child, 0)
sys.exit(os.waitstatus_to_exitcode(status))
