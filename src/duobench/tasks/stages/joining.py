"""Joining: conditions for two arms to plug two bodies together, each holding one.

That both arms once held a body each says nothing about who plugged them together. So each arm has
its own body from before the peg enters the socket until it is deep enough; what is plugged together
in any other way has to come apart, and to be joined again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from duobench.tasks.stages.insertion import (
    Port,
    in_any_way,
    inserted,
    led_in,
    tip_in_words,
    tip_off,
)
from duobench.tasks.stages.logic import (
    Predicate,
    held_for,
    leaf,
    since,
)
from duobench.tasks.stages.predicates import grasped_apart

SOCKET_REACH = 0.010
"""Largest distance in metres from a socket's axis to a tip that is in it: a peg that has just come
in may be shifted and turned as far as walls and chamfer let it."""
KEPT_DEPTH = 0.003
"""Least depth in metres of a tip that has not come out of its socket."""
LOST_SECONDS = 0.2
"""How long a grasp is lost before the joining was not done by both arms, in seconds: pads may lose
contact for a control step or two when peg and socket meet."""


def engaged(
    peg: Port,
    socket: Port,
    depth: float = 0.0,
) -> Predicate:
    """The peg's tip is inside the socket, or so little above it, however it is turned there.

    Args:
        peg: Tip of the peg.
        socket: Mouth of the socket.
        depth: How far inside the mouth the tip is at least, in metres; below 0, it is at most so
            far above the mouth.
    """
    return leaf(
        f"peg of {peg.body} is in a socket of {socket.body}",
        lambda state: led_in(state, peg, socket, depth, SOCKET_REACH),
        otherwise=lambda state: tip_in_words(state, peg, socket),
        off=lambda state: tip_off(state, peg, socket, depth),
    )


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Joining:
    """Predicates about a peg and the body with its sockets; made by `joining`."""

    joined: Predicate
    """The peg is deep in a socket, and each arm has held one of the bodies since before it came in,
    and does so now."""
    kept: Predicate
    """They were joined at an earlier step and have not come apart since."""


def joining(
    peg: Port, sockets: Sequence[Port], depth: float, *, unless: Predicate
) -> Joining:
    """The predicates for two bodies.

    Args:
        peg: Peg of the one body.
        sockets: Sockets of the other one; any of them will do.
        depth: How deep the peg is inserted at least, in metres.
        unless: What may not hold while they are joined, such as that something else holds one.
    """
    by_both = grasped_apart(peg.body, sockets[0].body)
    ways = [(peg, socket) for socket in sockets]
    touched = in_any_way(ways, engaged)
    deep = in_any_way(ways, partial(inserted, depth=depth))
    apart = ~in_any_way(ways, partial(engaged, depth=KEPT_DEPTH))
    spoilt = unless | held_for(~by_both, LOST_SECONDS)
    ready = (by_both & ~touched).called(f"{by_both.name} before the peg is in a socket")
    joined = deep & by_both & ~unless & since(ready, reset=spoilt)
    joined = joined.called("both arms join the two")
    kept = since(joined, reset=apart).told_of(
        "when each arm last held one of the two", by_both
    )
    return Joining(joined=joined, kept=kept)
