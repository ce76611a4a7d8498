"""How attempts at episodes end, and what it means for a score that some were begun again."""

from collections import Counter
from collections.abc import Iterable

SUCCESS, FAILURE, ERROR = "success", "failure", "error"
POLICY, SHARED = "policy", "shared policy"
WORKER, NODE, MACHINERY, STOPPED = "worker", "node", "machinery", "stopped"
TASK = "task"
ENDS = {
    SUCCESS: "the record of a success was removed",
    FAILURE: "the record of a failure was removed",
    ERROR: "the record of an error was removed",
    POLICY: "the policy's process ended by itself, or the connection to it was lost",
    SHARED: "the process of a policy that played several episodes ended or hung, or the connection "
    "to it was lost",
    TASK: "the task's own code failed",
    WORKER: "a simulator's process ended",
    NODE: "a node was lost",
    MACHINERY: "a server, a connection or a renderer failed",
    STOPPED: "the evaluation ended",
}
"""What the end of an attempt is called, and in words; `STOPPED` is one of which nothing is noted.
After the first three there was a record, which is not there any more."""
MOST_POLICY_ENDS = 2
"""How often a policy may end by itself in one episode, or be lost: the last time fails it."""
MARKED, MARK = 0.01, "†"
"""Share of successes by which the worst case differs where a score is marked, and how."""


def repeats_text(earlier: Iterable[tuple[str, ...]]) -> str:
    """How many episodes were begun more than once, and why, in a sentence; empty if none was.

    Args:
        earlier: How the earlier attempts at each episode ended.
    """
    each = list(earlier)
    repeated = sum(map(bool, each))
    if not repeated:
        return ""
    counts = Counter(end for ends in each for end in ends)
    why = "; ".join(f"{text} ({counts[end]})" for end, text in ENDS.items() if counts[end])
    return f"{repeated} of {len(each)} episodes were begun more than once: {why}."
