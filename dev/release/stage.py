"""What is built: a copy of the tracked files, whose first pages have links for an index."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
REPOSITORY = os.environ.get("DUOBENCH_REPOSITORY", "https://duobench.invalid")
"""Address of the repository, on which links and metadata are built: the one place that knows it.
The workflow that publishes sets the variable; without it the address is one that leads nowhere by
its name (RFC 2606), and what is built is for tests."""
IS_PUBLIC = not REPOSITORY.endswith(".invalid")
BRANCH = "main"
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")
_PICTURES = {".webp", ".png", ".jpg", ".svg", ".gif"}


def distributions(root: Path = ROOT) -> list[Path]:
    """Folders of all distributions, the core first, from the root."""
    return [
        Path(),
        *(
            path.parent.relative_to(root)
            for path in sorted(root.glob("plugins/*/*.toml"))
        ),
    ]


def version(root: Path = ROOT) -> str:
    """The one version that all distributions have.

    Raises:
        SystemExit: Another one has another.
    """
    source = (root / "src/duobench/core/versions.py").read_text(encoding="utf-8")
    found = re.search(r'^__version__ = "(.+)"$', source, re.MULTILINE)
    assert found is not None
    for folder in distributions(root)[1:]:
        project = tomllib.loads((root / folder / "pyproject.toml").read_text())[
            "project"
        ]
        core = [
            one for one in project["dependencies"] if one.startswith("duobench-fr3")
        ]
        if project["version"] != found[1] or not core[0].endswith(f"=={found[1]}"):
            sys.exit(
                f"{folder} is not of version {found[1]}, or needs another one of the core."
            )
    return found[1]


def absolute(text: str, folder: Path, repository: str = REPOSITORY) -> str:
    """A page whose links lead into the repository; `folder` is where it lies there.

    Pictures lead to the file itself, everything else to its page. What leads elsewhere, or to a
    part of the page itself, stays.
    """

    def link(found: re.Match[str]) -> str:
        mark, label, target = found.groups()
        if re.match(r"[a-z]+:|#", target):
            return found[0]
        path, _, part = target.partition("#")
        place = os.path.normpath(folder / path)
        kind = "raw" if Path(path).suffix in _PICTURES else "blob"
        part = f"#{part}" if part else ""
        return f"{mark}[{label}]({repository}/{kind}/{BRANCH}/{place}{part})"

    # A picture within a link is replaced first, then the link around it; code is left alone.
    parts = re.split(r"(```.*?```)", text, flags=re.DOTALL)
    return "".join(
        one if one.startswith("```") else _LINK.sub(link, one) for one in parts
    )


def addresses() -> str:
    """The table of the project's addresses, for `pyproject.toml`."""
    pages = {
        "Repository": REPOSITORY,
        "Documentation": f"{REPOSITORY}/tree/{BRANCH}/docs",
        "Changelog": f"{REPOSITORY}/blob/{BRANCH}/CHANGELOG.md",
        "Issues": f"{REPOSITORY}/issues",
    }
    return "\n[project.urls]\n" + "".join(
        f'{name} = "{page}"\n' for name, page in pages.items()
    )


def stage(out: Path) -> list[Path]:
    """Copy the tracked files into a folder, prepared for an index; the folders to build in."""
    shutil.rmtree(out, ignore_errors=True)
    listing = ["git", "-c", "safe.directory=*", "ls-files", "-z"]
    names = subprocess.run(
        listing, cwd=ROOT, check=True, capture_output=True
    ).stdout.decode()
    for name in filter(None, names.split("\0")):
        if (ROOT / name).is_file():
            (out / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, out / name)
    for folder in distributions(out):
        page = out / folder / "README.md"
        page.write_text(
            absolute(page.read_text(encoding="utf-8"), folder), encoding="utf-8"
        )
        with (out / folder / "pyproject.toml").open("a", encoding="utf-8") as file:
            file.write(addresses())
    return [out / folder for folder in distributions(out)]


def build(folder: Path, out: Path) -> list[Path]:
    """Build a source distribution, and the wheel from that, not from the folder."""
    hatch = [sys.executable, "-m", "hatchling", "build"]
    before = set(out.glob("*.tar.gz"))
    subprocess.run([*hatch, "-t", "sdist", "-d", str(out)], cwd=folder, check=True)
    (source,) = set(out.glob("*.tar.gz")) - before
    unpacked = out / ".unpacked"
    shutil.rmtree(unpacked, ignore_errors=True)
    with tarfile.open(source) as archive:
        # Python 3.11 has filters since 3.11.4.
        safe: Any = {"filter": "data"} if hasattr(tarfile, "data_filter") else {}
        archive.extractall(unpacked, **safe)
    (inside,) = unpacked.iterdir()
    before = set(out.glob("*.whl"))
    subprocess.run([*hatch, "-t", "wheel", "-d", str(out)], cwd=inside, check=True)
    shutil.rmtree(unpacked)
    return [source, *(set(out.glob("*.whl")) - before)]
