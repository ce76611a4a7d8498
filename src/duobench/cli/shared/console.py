"""Where the verbs print, and the command that called one of them."""

from __future__ import annotations

import inspect
import shlex
from collections.abc import Callable, Mapping

from rich.console import Console

PLAIN_WIDTH = 130
"""Columns when the output goes to a file or another program, which never wraps."""
_ELSEWHERE: Mapping[str, str] = {"out": "DIR", "server": "URL", "key_file": "FILE"}
"""What stands for a value that another machine has elsewhere, or that is nobody's business."""
_NO_MATTER = (
    *("workers", "retry_broken", "wait", "watch", "watch_port"),
    *("executor", "address", "policy_gpus"),
)
"""Options that no result depends on."""


def console() -> Console:
    """Standard output: coloured and as wide as the terminal, or plain and of one width.

    Text is printed as it is: `[name]` and `:name:` come from people, not from us, and only a
    terminal breaks its lines.
    """
    out = Console(highlight=False, markup=False, emoji=False, soft_wrap=True)
    if not out.is_terminal:
        out.width = PLAIN_WIDTH
    return out


def counted(count: int, noun: str) -> str:
    """A number and what it counts, such as "1 task" and "2 tasks"."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def command_line(verb: str, function: Callable[..., None], given: Mapping[str, object]) -> str:
    """The command that calls a verb, with every option that a result may depend on.

    Args:
        verb: Its name.
        function: The verb.
        given: Values of its parameters; one at its default is left out.
    """
    words = ["duobench", verb]
    for name, parameter in inspect.signature(function).parameters.items():
        value = given[name]
        if name in _NO_MATTER or value == parameter.default:
            continue
        flag = f"--{name.replace('_', '-')}"
        if "UseAppendAction" in str(parameter.annotation) and isinstance(value, tuple):
            words += [word for each in value for word in (flag, str(each))]
            continue
        words.append(flag)
        if name in _ELSEWHERE:
            words.append(_ELSEWHERE[name])
        elif isinstance(value, tuple):
            words += map(str, value)
        elif value is not True:
            words.append(str(value))
    return shlex.join(words)
