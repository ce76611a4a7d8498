"""The pages of the reference that follow from code: Python, commands, options, fields, messages."""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import inspect
import json
import re
import types
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
import tyro
from sphinx.pycode import ModuleAnalyzer
from tables import table

from duobench.cli.program import GROUPS, VERBS
from duobench.data.lerobot.options import ExportOptions
from duobench.data.schema import COLUMNS, EpisodeInfo
from duobench.envs.config import EnvConfig
from duobench.policy import PolicyMetadata
from duobench.real.rig import Rig
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.results.suite import SuiteChoice
from duobench.tasks.shifts.shift import Shift

DOCS = Path(__file__).parent
EXAMPLES = DOCS / "site_examples.txt"
"""Examples of the Python API by name, as an interpreter shows them; a test runs each."""
MESSAGES = DOCS.parent / "tests" / "errors.json"
"""What the program says when something is wrong; a test provokes each."""
PACKAGES = (
    "duobench",
    "duobench.envs",
    "duobench.policy",
    "duobench.evaluation",
    "duobench.evaluation.runners",
    "duobench.evaluation.replay",
    "duobench.data",
    "duobench.tasks",
    "duobench.world.objects",
    "duobench.world.looks",
    "duobench.printing",
)
"""Whose names are public, in the order in which people meet them."""
OPTIONS = {
    "Environments": ("`duobench.make(task, **options)` takes the fields as keywords.", EnvConfig),
    "Shifts": ("`EnvConfig.shift`, `duobench eval --shift`.", Shift),
    "Evaluations": ("Options of `duobench eval` that choose what is played.", SuiteChoice),
    "Exports": ("Options of `duobench export lerobot`.", ExportOptions),
    "Policies": ("What a policy says of itself in `metadata`.", PolicyMetadata),
}
SCHEMAS = {
    "A run": ("`run.json` of a folder that `duobench eval` writes.", Run),
    "A record": ("One file an episode in `records/`.", EpisodeRecord),
    "An episode of a data set": ("Metadata in the header of each Parquet file.", EpisodeInfo),
    "A rig": ("The file that describes real arms.", Rig),
}


def command_line() -> str:
    """Every verb, with what its parser takes."""
    lines = ["# The command line", "", "From the parsers: what `duobench VERB --help` says.", ""]
    for words, verb in verbs(VERBS):
        parser = parser_of(verb, words)
        lines += [f"## duobench {words}", "", plain(parser.description or ""), ""]
        taken = [action for action in parser._actions if action.dest != "help"]
        lines += [*map(option, taken), ""]
    return "\n".join(lines) + "\n"


def verbs(
    of: Mapping[str, Callable[..., None]], before: str = ""
) -> Iterator[tuple[str, Callable[..., None]]]:
    """Give all verbs with their words; those that have verbs of their own are not verbs."""
    for name, verb in of.items():
        words = f"{before} {name}".strip()
        if words in GROUPS:
            yield from verbs(GROUPS[words], words)
        else:
            yield words, verb


def parser_of(verb: Callable[..., None], words: str) -> argparse.ArgumentParser:
    """Return the parser that reads a verb's arguments."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # nothing else gives it as values
        return tyro.extras.get_parser(
            verb, prog=f"duobench {words}", config=(tyro.conf.EnumChoicesFromValues,)
        )


def option(action: argparse.Action) -> str:
    """Return a line of the list of options: names, what they take, and what that means."""
    takes = action.metavar if isinstance(action.metavar, str) else ""
    names = " or ".join(action.option_strings)
    return f"- `{' '.join(word for word in (names, takes) if word)}`: {plain(action.help or '')}"


def options() -> str:
    """Options of environments, evaluations, exports and policies."""
    return classes_page("Options", OPTIONS)


def schemas() -> str:
    """Fields of files, and of what they hold."""
    rows = [
        (f"`{one.name}`", np.dtype(one.dtype).name, "per step" if one.of_action else "per state")
        for one in COLUMNS
    ]
    told = "## Columns of an episode\n\n`Recording` says [what they hold](python.md)."
    columns = table(("column", "type", "there is one"), rows)
    return f"{classes_page('Schemas of files', SCHEMAS)}\n{told}\n\n{columns}"


def classes_page(title: str, of: Mapping[str, tuple[str, type]]) -> str:
    """Return a page on the fields of data classes, with those that are fields of them."""
    lines = [f"# {title}", "", "From the data classes, whose names stand behind each heading.", ""]
    told: set[type] = set()
    for heading, (about, cls) in of.items():
        lines += [f"## {heading}: `{cls.__name__}`", "", about, "", fields_table(cls)]
        told.add(cls)
        waiting = list(inner(cls))
        while waiting:
            one = waiting.pop(0)
            if one not in told:
                told.add(one)
                waiting += inner(one)
                first = plain((inspect.getdoc(one) or "").partition("\n\n")[0])
                lines += [f"### `{one.__name__}`", "", first, "", fields_table(one)]
    return "\n".join(lines) + "\n"


def inner(cls: type) -> Iterator[type]:
    """Give the data classes of the package that are in a class's fields."""
    hints = inspect.get_annotations(cls, eval_str=False)
    module = vars(importlib.import_module(cls.__module__))
    for field in dataclasses.fields(cls):
        for word in re.findall(r"\w+", str(hints.get(field.name, field.type))):
            found = module.get(word)
            if isinstance(found, type) and dataclasses.is_dataclass(found):
                yield found


def fields_table(cls: type) -> str:
    """Return the fields of a data class with their types, defaults and what is said below them."""
    told = said_of(cls)
    rows = []
    for field in dataclasses.fields(cls):
        kind = field.type if isinstance(field.type, str) else inspect.formatannotation(field.type)
        rows.append((f"`{field.name}`", code(kind), default(field), cell(told[field.name])))
    return table(("field", "type", "default", "meaning"), rows)


def said_of(cls: type) -> dict[str, str]:
    """Return what stands below each field, in the class or those above it."""
    found: dict[str, str] = {}
    for one in reversed(cls.__mro__):
        if dataclasses.is_dataclass(one):
            analyzer = ModuleAnalyzer.for_module(one.__module__)
            for (owner, name), lines in analyzer.find_attr_docs().items():
                if owner == one.__name__:
                    found[name] = " ".join(lines)
    return {field.name: found.get(field.name, "") for field in dataclasses.fields(cls)}


def default(field: dataclasses.Field[object]) -> str:
    """Return the default of a field as code."""
    if field.default is not dataclasses.MISSING:
        value = field.default
        shown = repr(value)
        return code(type(value).__name__ if len(shown) > 60 or " object at " in shown else shown)  # noqa: PLR2004
    return "" if field.default_factory is dataclasses.MISSING else "empty"


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
        groups.setdefault(group, []).append((cell(when), cell(sentence), f"`{kind}`"))
    for group, rows in groups.items():
        lines += [f"## {group[:1].upper()}{group[1:]}", ""]
        lines.append(table(("when", "what is said", "error"), rows))
    return "\n".join(lines) + "\n"


def python() -> str:
    """Return every public name, from its docstring, with its example."""
    lines = [
        "# The Python API",
        "",
        "What may be imported from where, and stays. Pages show a few names of other packages, "
        "which hold for this version. Anything else is private.",
        "",
    ]
    shown = examples()
    for package in PACKAGES:
        module = importlib.import_module(package)
        lines += [f"## {package}", "", plain((module.__doc__ or "").partition("\n\n")[0]), ""]
        for name in sorted(module.__all__, key=str.lower):
            lines += [*described(f"{package}.{name}", getattr(module, name))]
            if (example := shown.pop(f"{package}.{name}", "")) != "":
                lines += ["```python", example.rstrip(), "```", ""]
    if shown:
        raise ValueError(
            f"{EXAMPLES.name} has examples of {', '.join(shown)}, which are not public"
        )
    return "\n".join(lines) + "\n"


def described(name: str, value: object) -> Iterator[str]:
    """Give the lines by which autodoc describes a public name; of a value, its type alone."""
    if inspect.isclass(value):
        yield from ("```{eval-rst}", f".. autoclass:: {name}", "   :members:", "```", "")
    elif isinstance(inspect.unwrap(value), types.FunctionType):  # also one that is cached
        yield from ("```{eval-rst}", f".. autofunction:: {name}", "```", "")
    else:
        kind = type(value).__name__
        yield from ("```{eval-rst}", f".. py:data:: {name}", f"   :type: {kind}", "```", "")


def examples() -> dict[str, str]:
    """Return the examples by the name that they stand under."""
    text = EXAMPLES.read_text(encoding="utf-8")
    found = re.findall(r"^## (\S+)\n(.*?)(?=^## |\Z)", text, flags=re.DOTALL | re.MULTILINE)
    return {name: example.strip("\n") + "\n" for name, example in found}


def plain(text: str) -> str:
    """Return text of a docstring as Markdown, without what would be taken for marks."""
    return re.sub(r"(?<!`)([<>*_|])(?![^`\n]*`)", r"\\\1", " ".join(text.split()))


def cell(text: str) -> str:
    """Return text as a cell of a table."""
    return plain(text).replace("\\|", "|").replace("|", "\\|")


def code(text: str) -> str:
    """Return code as a cell of a table."""
    return f"`{text}`".replace("|", "\\|")


REFERENCE: Mapping[str, Callable[[], str]] = {
    "python": python,
    "command_line": command_line,
    "options": options,
    "schemas": schemas,
    "messages": messages,
}
"""What writes each page."""
