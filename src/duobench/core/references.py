"""Import paths `module:attribute`, and public names that are loaded on first use."""

import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any, NamedTuple

from duobench.core.errors import ImportPathError, UnknownNameError, traceback_text


def load(
    path: str,
    kind: str,
    fits: Callable[[object], bool],
) -> Any:
    """Import what a path `module:attribute` names, such as "my_tasks:STACK".

    It should be of a kind, such as "task" for messages; `fits` says whether a value is.
    """
    module_name, _, attribute = path.partition(":")
    if attribute and ("/" in module_name or module_name.endswith(".py")):
        raise ImportPathError(
            f"{path!r} names a file. {_in_words(Path(module_name), attribute)}"
        )
    if not (module_name and attribute) or module_name.startswith("."):
        raise ImportPathError(
            f"{path!r} is no `module:attribute`, such as my_module:NAME."
        )
    module = _imported(module_name)
    value = getattr(module, attribute, None)
    if not fits(value):
        known = [
            name
            for name, value in vars(module).items()
            if fits(value)
            and not name.startswith("_")
            and not _is_foreign(value, module_name)
        ]
        if module_name == "__main__" and not known:
            raise ImportPathError(
                f"{path!r} is another module in each process; name the file instead, such as "
                f"my_script:{attribute} for my_script.py."
            )
        but = (
            ""
            if value is None
            else f", whose {attribute} is of type {type(value).__name__},"
        )
        raise UnknownNameError(kind, attribute, known, f"Module {module_name}{but}")
    return value


def _in_words(file: Path, attribute: str) -> str:
    """Name by which a file is imported, and its folder, in words."""
    file, here = file.expanduser(), Path.cwd()
    file = file.parent.resolve() / file.stem
    folder = file.parent
    while (folder / "__init__.py").exists():
        folder = folder.parent
    other = ""
    if folder == file.parent and folder != here and file.is_relative_to(here):
        folder, other = here, f"; in its own folder, {file.stem}:{attribute}"
    name = ".".join(file.relative_to(folder).parts)
    where = {here: "In this folder", file.parent: "In its folder"}.get(
        folder, f"In {folder}"
    )
    return f"{where}, the module is found by its name: {name}:{attribute}{other}"


def _imported(name: str) -> Any:
    try:
        return import_module(name)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # foreign code runs here
        if isinstance(error, ModuleNotFoundError) and f"{name}.".startswith(
            f"{error.name}."
        ):
            raise ImportPathError(
                f"There is no module named {error.name!r}. Install it, or put its folder on "
                "PYTHONPATH."
            ) from error
        raise ImportPathError(
            f"Module {name!r} cannot be imported.\n{traceback_text(error, skip=1).strip()}"
        ) from error


def _is_foreign(value: object, module_name: str) -> bool:
    return isinstance(value, (type, FunctionType)) and value.__module__ != module_name


class Lazy(NamedTuple):
    """Functions and names by which a package imports its public names on first use (PEP 562)."""

    get: Callable[[str], object]
    """`__getattr__` of the package."""
    directory: Callable[[], list[str]]
    """`__dir__` of the package."""
    names: list[str]
    """`__all__` of the package."""


def lazy(package: str, origins: Mapping[str, Sequence[str]]) -> Lazy:
    """Let a package import its public names on first use.

    Python looks for a name here only if the package has no attribute of it, as an imported module
    is: no module of the package may be called as one of the names.

    Args:
        package: `__name__` of the package.
        origins: Names by the module that defines them. Type checkers see the same imports below
            `if TYPE_CHECKING`, as `NAME as NAME`.
    """
    modules = {name: module for module, names in origins.items() for name in names}

    def get(name: str) -> object:
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(modules[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    def directory() -> list[str]:
        return sorted({*vars(sys.modules[package]), *modules})

    return Lazy(get, directory, list(modules))
