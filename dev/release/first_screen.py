"""Play the commands with which README begins, in a bare Debian: python3, make and git alone.

    python -m dev.release.first_screen [--tests "-m ... -k ..."] [--keep]

First by a user who may install nothing: without a module that makes environments, then without
OpenGL, each command ends well or in a sentence. Then by root, for whom what is missing is
installed; the demo again without a network. What is committed is played. Needs what
`dev.release.container` needs.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys

from dev.release.container import Root, debian
from dev.release.stage import ROOT

SUITE = "bookworm"
HAD = "apt-get update && apt-get install --yes --no-install-recommends python3 make git"
LEARNED = "apt-get install --yes --no-install-recommends python3-venv"
FORGOTTEN = "apt-get purge --yes --auto-remove python3-venv python3.11-venv"
NO_VENV = (
    "python3 cannot make environments here; as root: apt-get install python3.11-venv"
)
NO_VIDEOS = "Nothing renders images here, so there will be no videos"
NO_TESTS = "The tests render images, but OpenGL is missing; as root: apt-get install"
REPORT = "Report: demo-run/index.html"
PASSED = " passed"


def first_commands() -> tuple[str, str]:
    """The commands of the first block of README."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    block = re.findall(r"^```sh\n(.*?)^```", text, re.DOTALL | re.MULTILINE)[0]
    demo, test = (line.partition("#")[0].strip() for line in block.splitlines())
    return demo, test


def clone(root: Root, user: str) -> None:
    """Go on as a user, in a clone of this repository of which nothing is built."""
    root.user = user
    place = f"{root.home}/duobench"
    there = root.folder / place.lstrip("/")
    subprocess.run(["git", "clone", "--quiet", "--no-local", ROOT, there], check=True)
    root.user, root.place = "root", "/"
    root.run(["chown", "--recursive", f"{user}:", place])
    root.user, root.place = user, place


def expect(
    root: Root, command: str, code: int, words: str, *, network: bool = True
) -> str:
    """Play a command, which ends with an exit code and says some words; all that it says.

    Raises:
        SystemExit: It ends otherwise.
    """
    print(
        f"{root.user}{'' if network else ', without a network'}: {command}", flush=True
    )
    ended, said = root.hear(["sh", "-c", command], network=network)
    if ended != code or words not in said:
        sys.exit(
            f"{said}\nIt ended with {ended}, and should with {code} and say: {words}"
        )
    print("  " + "\n  ".join(said.splitlines()[-3:]), flush=True)
    return said


def main() -> None:
    """Play all of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tests", default="", help="words of pytest, for fewer tests")
    parser.add_argument(
        "--keep", action="store_true", help="keep the folder of the Debian"
    )
    asked = parser.parse_args()
    demo, test = first_commands()
    with debian(SUITE, keep=asked.keep) as root:
        expect(root, f"{HAD} && useradd --create-home reader", 0, "")

        clone(root, "reader")
        for command in (demo, test):
            _, *after = expect(root, command, 2, NO_VENV).splitlines()
            assert all(line.startswith("make: ") for line in after)
        root.user = "root"
        expect(root, LEARNED, 0, "")
        root.user = "reader"
        assert REPORT in expect(root, demo, 0, NO_VIDEOS)
        expect(root, test, 2, NO_TESTS)
        assert any(root.folder.glob("home/*/duobench/demo-run/replays/**/*.track"))

        root.user, root.place = "root", "/"
        expect(root, FORGOTTEN, 0, "")
        clone(root, "root")
        root.environment |= {"PYTEST_ADDOPTS": asked.tests} if asked.tests else {}
        assert NO_VIDEOS not in expect(root, demo, 0, REPORT)
        expect(root, demo, 0, REPORT, network=False)
        expect(root, test, 0, PASSED)
    print("All commands were played, and each ended as it should.")


if __name__ == "__main__":
    main()
