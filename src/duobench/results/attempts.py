"""Names of how an attempt at an episode ends."""

SUCCESS, FAILURE, ERROR = "success", "failure", "error"
"""Ends with a record; as the end of an earlier attempt, the record was removed."""
POLICY = "policy"
"""The policy's process ended by itself, or the connection to it was lost."""
SHARED = "shared policy"
"""The same of a policy that played several episodes; it counts for none of them."""
WORKER, NODE = "worker", "node"
"""A simulator's process, or a node of a cluster, was lost."""
MACHINERY = "machinery"
"""A server, a connection or a renderer failed."""
TASK = "task"
"""The task's own code failed."""
STOPPED = "stopped"
"""The evaluation ended: nothing is noted of the end of such an attempt."""
ENDS = frozenset(
    {
        SUCCESS,
        FAILURE,
        ERROR,
        POLICY,
        SHARED,
        WORKER,
        NODE,
        MACHINERY,
        TASK,
        STOPPED,
    }
)
MOST_POLICY_ENDS = 2
"""Times that a policy may end by itself or be lost in one episode; the last fails it."""
