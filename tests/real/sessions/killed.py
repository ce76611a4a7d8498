"""A session in a process of its own: prints the page's address; each line of input is a chunk."""

import sys
import threading
from pathlib import Path

from tests.real.sessions import toys
from tests.real.sessions.operator import POLICIES, Stand


def lead() -> None:
    for _line in sys.stdin:
        toys.Patient.gate.release()


if __name__ == "__main__":
    stand = Stand(Path(sys.argv[1]), POLICIES)
    threading.Thread(target=lead, daemon=True).start()
    sys.stdout.write(f"{stand.server.url}\n")
    sys.stdout.flush()
    stand.session.run()
