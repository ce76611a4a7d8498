"""Build, check and try a release; what is there already is not done again.

    python -m dev.release [--only-build]

Everything is left in `dist/`: what would be uploaded, a wheelhouse for each Python, and
`release.json`, which says what was tried of files of which SHA-256. The same command goes on where
it was stopped.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
import subprocess
import sys
import tempfile
from email.parser import Parser
from pathlib import Path
from typing import Any
from zipfile import ZipFile

from dev.release import interpreters
from dev.release.stage import IS_PUBLIC, ROOT, build, stage, version

DIST = ROOT / "dist"
WORK = DIST / "work"
"""What is downloaded and installed on the way; it may be deleted."""


def check(files: list[Path], expected: str) -> list[dict[str, Any]]:
    """Check metadata and description as the index does; what each file is."""
    words = ["twine", "check", "--strict", *map(str, files)]
    subprocess.run([sys.executable, "-m", *words], check=True)
    facts = []
    for path in files:
        if path.suffix == ".whl":
            _check_metadata(path, expected)
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        facts.append(
            {"file": path.name, "bytes": path.stat().st_size, "sha256": digest}
        )
    return facts


def _check_metadata(wheel: Path, expected: str) -> None:
    with ZipFile(wheel) as archive:
        (name,) = [
            one for one in archive.namelist() if one.endswith(".dist-info/METADATA")
        ]
        told = Parser().parsestr(archive.read(name).decode())
        licences = [one for one in archive.namelist() if ".dist-info/licenses/" in one]
    wrong = [
        *(["its version"] if told["Version"] != expected else []),
        *(["its licence's text"] if not licences else []),
        *(
            one
            for one in ("Author", "License-Expression", "Requires-Python")
            if not told[one]
        ),
        *(one for one in ("Project-URL", "Classifier") if not told.get_all(one)),
        *(["a link of its page"] if "](docs/" in told.get_payload() else []),
    ]
    if wrong:
        sys.exit(f"{wheel.name} lacks {', '.join(wrong)}, or has another.")


def make() -> list[Path]:
    """Build every distribution into `dist/`, in place of earlier ones."""
    DIST.mkdir(exist_ok=True)
    for old in (*DIST.glob("*.whl"), *DIST.glob("*.tar.gz")):
        old.unlink()
    with tempfile.TemporaryDirectory() as folder:
        return [
            path for one in stage(Path(folder) / "tree") for path in build(one, DIST)
        ]


def tried(wheels: list[Path], done: dict[str, str]) -> dict[str, str]:
    """Install the wheels in every Python that is here, and play; what came of it, by its version.

    What was done with the same wheels is taken as it stands.
    """
    for python in interpreters.SUPPORTED:
        if python in done:
            continue
        program = interpreters.find(python)
        if program is None:
            print(f"Python {python}: not here", flush=True)
            continue
        here = WORK / python
        ours = [wheel for wheel in wheels if wheel == wheels[0] or python != "3.11"]
        interpreters.fill(program, wheels[0], here / "wheelhouse")
        programs = interpreters.install(
            program, ours, here / "wheelhouse", here / "environment"
        )
        said = interpreters.play(programs, here / "empty")
        (last,) = [line for line in said.splitlines() if line.startswith("Report: ")]
        count = len(list((here / "wheelhouse").iterdir()))
        done[python] = f"installed from {count} wheels, played; {last}"
        print(f"Python {python}: {done[python]}", flush=True)
        shutil.rmtree(here / "environment")
        write({"tried": done})
    return done


def write(facts: dict[str, Any]) -> None:
    """Add to what is known of this release."""
    path = DIST / "release.json"
    known = json.loads(path.read_text()) if path.exists() else {}
    path.write_text(json.dumps(known | facts, indent=1) + "\n")


def main() -> None:
    """Make a release as far as asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--only-build", action="store_true", help="build and check, install nothing"
    )
    asked = parser.parse_args()
    number, files = version(), make()
    facts = check(files, number)
    path = DIST / "release.json"
    known = json.loads(path.read_text()) if path.exists() else {}
    if known.get("files") != facts:  # anything else was tried with other files
        known = {}
        path.write_text("{}\n")
    write({"version": number, "files": facts})
    for one in facts:
        print(f"{one['file']}: {one['bytes'] / 1e6:.2f} MB, SHA-256 {one['sha256']}")
    if not asked.only_build:
        wheels = [file for file in files if file.suffix == ".whl"]
        tried(wheels, known.get("tried", {}))
        resolved = known.get("resolved", {})
        for python, system in interpreters.ELSEWHERE:
            name = f"{python} on {system}"
            resolved[name] = resolved.get(name) or interpreters.resolve(
                wheels[0], python, system
            )
            print(f"Python {name}: {resolved[name]}", flush=True)
            write({"resolved": resolved})
    if not IS_PUBLIC:
        print(
            "No address of a repository is known (DUOBENCH_REPOSITORY): links of these pages lead "
            "nowhere, and they are for tests, not for an index."
        )


if __name__ == "__main__":
    main()
