"""The pages of the reference that follow from code: Python, commands, options, fields, messages."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import json
import re
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import tyro
from tables import table

from duobench.cli.program import COMMANDS, function_of
from duobench.data.lerobot.options import ExportOptions
from duobench.data.schema import COLUMNS, EpisodeInfo
from duobench.envs.config import EnvConfig
from duobench.policy import PolicyMetadata
from duobench.real.rig import ArmConfig, CameraConfig, GripperConfig, Rig
from duobench.results.records import Record
from duobench.results.run import Run, TimeLimits
from duobench.results.suite import SuiteChoice
from duobench.tasks.shifts.shift import Shift
from duobench.world.looks.look import Look

DOCS = Path(__file__).parent
MESSAGES = DOCS.parent / "tests" / "errors.json"
"""What the program says when something is wrong; a test provokes each."""
PACKAGES = (
    "duobench",
    "duobench.envs",
    "duobench.policy",
    "duobench.evaluation",
    "duobench.evaluation.runners",
    "duobench.evaluation.replay",
    "duobench.results",
    "duobench.data",
    "duobench.tasks",
    "duobench.world.objects",
    "duobench.world.looks",
    "duobench.printing",
)
"""Packages whose names are public, in the order in which people meet them."""
OPTIONS = {
    "Environments, `duobench.make`": (EnvConfig, Look, Shift),
    "Policies, `metadata`": (PolicyMetadata,),
    "Evaluations, `duobench eval`": (SuiteChoice,),
    "Exports, `duobench export lerobot`": (ExportOptions,),
}
SCHEMAS = {
    "A run, `run.json`": (Run, TimeLimits),
    "A record, `records/*/*/*.json`": (Record,),
    "An episode of a data set, the header of its Parquet file": (EpisodeInfo,),
    "A rig, `rig.json`": (Rig, ArmConfig, GripperConfig, CameraConfig),
}


def python() -> str:
    """Return what each package offers, which is what its `__init__` lists."""
    lines = [
        "# The Python API",
        "",
        "What may be imported from where, and stays. Pages show a few names of other packages, "
        "which hold for this version. Anything else is private.",
        "",
    ]
    shown: set[object] = set()
    for package in PACKAGES:
        module = importlib.import_module(package)
        values = {
            name: inspect.unwrap(getattr(module, name)) for name in module.__all__
        }
        kinds = {name: one for name, one in values.items() if inspect.isclass(one)}
        again = sorted(name for name, kind in kinds.items() if kind in shown)
        shown |= set(kinds.values())
        options = ["members", "imported-members", "undoc-members"]
        if again:
            options.append(f"exclude-members: {', '.join(again)}")
        lines += [f"## {package}", "", *autodoc("module", package, *options)]
        if again:
            names = ", ".join(f"`{name}`" for name in again)
            lines += [f"It also has these, described above: {names}.", ""]
        for name, value in sorted(values.items()):
            if not (inspect.isclass(value) or inspect.isroutine(value)):
                lines += autodoc("data", f"{package}.{name}", "no-value")
    return "\n".join(lines)


def classes(title: str, of: Mapping[str, tuple[type, ...]]) -> str:
    """Return a page on the fields of data classes."""
    lines = [f"# {title}", ""]
    for heading, kinds in of.items():
        lines += [f"## {heading}", ""]
        for kind in kinds:
            fields = ", ".join(field.name for field in dataclasses.fields(kind))
            options = (f"members: {fields}", "undoc-members", "no-index")
            lines += autodoc("class", f"{kind.__module__}.{kind.__name__}", *options)
    return "\n".join(lines)


def autodoc(kind: str, name: str, *options: str) -> list[str]:
    """Return the lines by which autodoc describes a module, a class or a value."""
    marks = [
        f"   :{option}" if ":" in option else f"   :{option}:" for option in options
    ]
    return ["```{eval-rst}", f".. auto{kind}:: {name}", *marks, "```", ""]


def schemas() -> str:
    """Return the fields of files, and the columns of an episode."""
    rows = [
        (
            f"`{one.name}`",
            np.dtype(one.dtype).name,
            "per step" if one.of_action else "per state",
        )
        for one in COLUMNS
    ]
    told = "## Columns of an episode\n\n`Recording` says [what they hold](python.md)."
    columns = table(("column", "type", "there is one"), rows)
    return f"{classes('Schemas of files', SCHEMAS)}\n{told}\n\n{columns}"


def command_line() -> str:
    """Return every command, with what its parser takes."""
    lines = ["# The command line", "", "What `duobench COMMAND --help` says.", ""]
    for words in COMMANDS:
        with warnings.catch_warnings():
            # Nothing else gives what a parser takes as values.
            warnings.simplefilter("ignore", DeprecationWarning)
            parser = tyro.extras.get_parser(
                function_of(words), config=(tyro.conf.EnumChoicesFromValues,)
            )
        lines += [f"## duobench {words}", "", plain(parser.description or ""), ""]
        for action in parser._actions[1:]:  # without --help
            names = ", ".join(action.option_strings)
            taken = f"{names} {action.metavar or ''}".strip()
            lines += [f"`{taken}`", f": {plain(action.help or '')}", ""]
    return "\n".join(lines)


def messages() -> str:
    """What to do when the program says that something is wrong: its own words."""
    known: dict[str, str] = json.loads(MESSAGES.read_text(encoding="utf-8"))
    lines = [
        "# Messages",
        "",
        "What DuoBench says when something is wrong, and what would have worked. Search here for "
        "the words that you see; names and numbers in them are examples. `duobench doctor` looks "
        "at the machine, `duobench real doctor` at a rig.",
        "",
    ]
    groups: dict[str, list[tuple[str, str, str]]] = {}
    for about, said in known.items():
        group, _, when = about.partition(": ")
        kind, _, sentence = said.partition(": ")
        groups.setdefault(group, []).append((plain(when), plain(sentence), f"`{kind}`"))
    for group, rows in groups.items():
        lines += [f"## {group[:1].upper()}{group[1:]}", ""]
        lines.append(table(("when", "what is said", "error"), rows))
    return "\n".join(lines) + "\n"


def plain(text: str) -> str:
    """Return text of a program as Markdown, without what would be taken for marks."""
    return re.sub(r"(?<!`)([<>*_|])(?![^`\n]*`)", r"\\\1", " ".join(text.split()))


REFERENCE: Mapping[str, Callable[[], str]] = {
    "python": python,
    "command_line": command_line,
    "options": lambda: classes("Options", OPTIONS),
    "schemas": schemas,
    "messages": messages,
}
"""What writes each page."""
