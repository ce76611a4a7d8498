"""From an import path `module:attribute` to what it names, and public names loaded on first use."""

import ast
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, NoReturn

from duobench.core.errors import ImportPathError, UnknownNameError, traceback_text


def load(path: str, kind: str, fits: Callable[[object], bool]) -> Any:
    """Import what a path `module:attribute` names, such as "my_tasks:STACK".

    It should be of a kind, such as "task" for messages; `fits` says whether a value is.
    """
    module_name, _, attribute = path.partition(":")
    if attribute and ("/" in module_name or module_name.endswith(".py")):
        raise ImportPathError(f"{path!r} names a file. {_in_words(Path(module_name), attribute)}")
    if not (module_name and attribute) or module_name.startswith("."):
        raise ImportPathError(f"{path!r} is no `module:attribute`, such as my_module:NAME.")
    module = _imported(module_name)
    value = getattr(module, attribute, None)
    if not fits(value):
        known = [
            name
            for name, value in vars(module).items()
            if fits(value) and not name.startswith("_") and not _is_foreign(value, module_name)
        ]
        if module_name == "__main__" and not known:
            raise ImportPathError(
                f"{path!r} is another module in each process; name the file instead, such as "
                f"my_script:{attribute} for my_script.py."
            )
        but = "" if value is None else f", whose {attribute} is of type {type(value).__name__},"
        raise UnknownNameError(kind, attribute, known, f"Module {module_name}{but}")
    return value


def _in_words(file: Path, attribute: str) -> str:
    """By which name a file is imported, and from which folder."""
    file, here = file.expanduser(), Path.cwd()
    file = file.parent.resolve() / file.stem
    folder = file.parent
    while (folder / "__init__.py").exists():
        folder = folder.parent
    other = ""
    if folder == file.parent and folder != here and file.is_relative_to(here):
        folder, other = here, f"; in its own folder, {file.stem}:{attribute}"
    name = ".".join(file.relative_to(folder).parts)
    where = {here: "In this folder", file.parent: "In its folder"}.get(folder, f"In {folder}")
    return f"{where}, the module is found by its name: {name}:{attribute}{other}"


def _imported(name: str) -> Any:
    try:
        return import_module(name)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # anybody's code runs here
        if isinstance(error, ModuleNotFoundError) and f"{name}.".startswith(f"{error.name}."):
            raise ImportPathError(
                f"There is no module named {error.name!r}. Install it, or put its folder on "
                "PYTHONPATH."
            ) from error
        raise ImportPathError(
            f"Module {name!r} cannot be imported.\n{traceback_text(error, skip=1).strip()}"
        ) from error


def _is_foreign(value: object, module_name: str) -> bool:
    return isinstance(value, (type, FunctionType)) and value.__module__ != module_name


class _LazyPackage(ModuleType):
    """A package that imports its public names on first use."""

    origins: Mapping[str, str]

    def __getattr__(self, name: str) -> Any:
        if name not in self.origins:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        value = getattr(import_module(self.origins[name]), name)
        setattr(self, name, value)
        return value

    def __call__(self, *_: Any, **__: Any) -> NoReturn:
        hint = f"; {self.__name__}.names() lists them" if "names" in self.origins else ""
        raise TypeError(f"{self.__name__} is a package{hint}.")

    def __setattr__(self, name: str, value: Any) -> None:
        if not (isinstance(value, ModuleType) and name in self.origins):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self.origins})


def lazy(package: str) -> None:
    """Let a package import its public names on first use.

    The names are those that its `__init__`, which calls this at its end, imports from modules under
    `if TYPE_CHECKING`: what type checkers see is what there is. `import NAME as NAME` tells them
    that it is public.
    """
    module = sys.modules[package]
    source = Path(str(module.__file__)).read_text(encoding="utf-8")
    origins = {
        alias.name: node.module
        for block in ast.parse(source).body
        if isinstance(block, ast.If)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    vars(module).update(origins=origins, __all__=list(origins))
    module.__class__ = _LazyPackage
