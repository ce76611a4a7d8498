"""Panel of a session in which arms move: numbered steps, and what may be pressed now.

One source of words and states for every place where a session is led: pages and headset get it
with their status, a terminal prints it. A press is the same message wherever it comes from.
"""

from dataclasses import dataclass
from typing import Any

import msgspec

from duobench.web.messages import PageMessage

LEAD, SOLVED = "Lead", "Solved?"
"""Steps of a session in which a person leads the arms."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Button:
    """Something that may be pressed, or could be if nothing stood against it."""

    id: str
    """Name, which pages give its element."""
    words: str
    message: PageMessage
    """Message that a press is."""
    key: str = ""
    """Key at a terminal; empty where it has none."""
    why_not: str = ""
    """Reason why it cannot be pressed now; empty where it can."""
    is_next: bool = False
    """Whether it leads to the next step."""

    def to_json(self) -> dict[str, Any]:
        """Return what a page draws."""
        return {
            "id": self.id,
            "words": self.words,
            "message": msgspec.to_builtins(self.message),
            "why_not": self.why_not,
            "is_next": self.is_next and not self.why_not,
        }


@dataclass(frozen=True, kw_only=True, slots=True)
class Panel:
    """Steps of a session, the present one, and its buttons."""

    steps: tuple[str, ...]
    """All steps in order, in words."""
    now: int
    """Index of the present step; their number once all are done."""
    title: str
    """State in a few words."""
    todo: str = ""
    """Sentences that say what is to be done now."""
    buttons: tuple[Button, ...] = ()
    holding: str = ""
    """Sentence beside the hold; empty for that of real arms."""
    can_hold: bool = False
    """Whether arms move, or may be moved at once: Space holds them then."""

    @property
    def pressable(self) -> dict[str, Button]:
        """Buttons that can be pressed at a terminal, by their keys."""
        return {
            each.key: each for each in self.buttons if each.key and not each.why_not
        }

    @property
    def text(self) -> str:
        """The panel at a terminal: the step, what is to be done, and the keys."""
        number = min(self.now + 1, len(self.steps))
        head = f"{number} of {len(self.steps)}, {self.title}: {self.todo}"
        keys = [f"{key}: {each.words}" for key, each in self.pressable.items()]
        return "\n".join([head.removesuffix(": "), "; ".join(keys)]).rstrip()

    def to_json(self) -> dict[str, Any]:
        """Return what pages draw, in their status."""
        return {
            "steps": list(self.steps),
            "now": self.now,
            "title": self.title,
            "todo": self.todo,
            "buttons": [each.to_json() for each in self.buttons],
            "holding": self.holding,
            "can_hold": self.can_hold,
        }
