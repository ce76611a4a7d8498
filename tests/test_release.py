"""What goes to an index: links that work there, one version, commands that a reader would run."""

import re
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from dev.release import container, first_screen, interpreters
from dev.release.stage import absolute, addresses, build, distributions, version
from duobench.core.versions import __version__
from tests.test_repository import ROOT, tracked

HERE = "https://example.invalid/us/it"


@pytest.mark.parametrize(
    ("folder", "before", "after"),
    [
        (".", "[a](docs/a.md)", f"[a]({HERE}/blob/main/docs/a.md)"),
        (".", "[a](docs/a.md#part)", f"[a]({HERE}/blob/main/docs/a.md#part)"),
        (".", "![a](docs/a.webp)", f"![a]({HERE}/raw/main/docs/a.webp)"),
        ("plugins/x", "[a](../../README.md)", f"[a]({HERE}/blob/main/README.md)"),
        ("plugins/x", "[a](LICENSE)", f"[a]({HERE}/blob/main/plugins/x/LICENSE)"),
        (".", "[two\nlines](a.md)", f"[two\nlines]({HERE}/blob/main/a.md)"),
        (".", "[a](https://b.example/c.md)", "[a](https://b.example/c.md)"),
        (".", "[a](mailto:a@b.example)", "[a](mailto:a@b.example)"),
        (".", "[a](#part)", "[a](#part)"),
        (".", "```python\nx[0](y)\n```", "```python\nx[0](y)\n```"),
    ],
)
def test_links_lead_into_the_repository(folder: str, before: str, after: str) -> None:
    assert absolute(before, Path(folder), HERE) == after


@pytest.mark.parametrize("folder", distributions(), ids=str)
def test_no_link_of_a_first_page_is_relative_on_an_index(folder: Path) -> None:
    text = absolute((ROOT / folder / "README.md").read_text(encoding="utf-8"), folder, HERE)
    text = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    links = re.findall(r"\]\(([^)\s]+)\)", text)
    assert any(HERE in link for link in links)
    assert [link for link in links if not link.startswith(("https:", "#"))] == []
    for link in links:
        path = re.fullmatch(rf"{HERE}/(?:blob|raw)/main/([^#]+)(?:#.*)?", link)
        assert path is None or (ROOT / path[1]).exists(), link


def test_all_distributions_have_the_version_of_the_core() -> None:
    assert len(distributions()) > 1
    assert version() == __version__


def test_an_address_stands_in_the_table_of_addresses_alone() -> None:
    """Whoever knows the repository's address sets a variable, and no file has one."""
    assert "[project.urls]" not in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert addresses().count("https://duobench.invalid") == len(addresses().splitlines()) - 2


def test_what_is_played_is_the_first_door_of_the_first_page() -> None:
    modules, commands = interpreters.first_commands()
    assert "my_policy.py" in modules
    assert [line.split()[1] for line in commands] == ["eval"]


def test_the_first_page_begins_with_what_is_played_in_a_bare_debian_and_what_checks_call() -> None:
    assert first_screen.first_commands() == ("make demo", "make test")
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(readme[: readme.index("make demo")].splitlines()) <= 12
    checks = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert re.search(r"^make test ", checks, re.MULTILINE)


def test_a_python_is_found_by_its_version_alone() -> None:
    here = f"{sys.version_info.major}.{sys.version_info.minor}"
    assert interpreters.find(here)
    assert interpreters.find("2.0") is None


def files_of(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return {name for name in archive.namelist() if name.startswith("duobench/")}


@pytest.mark.slow
def test_a_source_distribution_has_what_its_wheel_needs_and_no_tests(tmp_path: Path) -> None:
    source, wheel = build(ROOT, tmp_path)
    assert "duobench/py.typed" in files_of(wheel)
    with tarfile.open(source) as archive:
        inside = {name.split("/")[1] for name in archive.getnames()}
    assert {"src", "pyproject.toml", "LICENSE"} <= inside
    assert not inside & {"docs", "tests", "dev", "examples", "Makefile"}


@pytest.mark.slow
def test_instructions_of_the_container_can_all_be_played(tmp_path: Path) -> None:
    text = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    (first, image), *rest = container.steps(text)
    assert (first, image.partition(":")[0]) == ("FROM", "debian")
    root = container.Root(tmp_path)
    for step in rest:
        if step[0] != "RUN":
            root.play(step, ROOT)
    _, wheel = build(tmp_path / "src", tmp_path)
    assert "duobench/py.typed" in files_of(wheel)
    assert (root.user, root.place, root.entry, root.command) == (
        "runner",
        "/runs",
        ["duobench"],
        ["doctor"],
    )
    with pytest.raises(ValueError, match="VOLUME"):
        root.play(("VOLUME", "x"), ROOT)


def test_what_a_container_is_built_from_is_let_in() -> None:
    allowed = (ROOT / ".dockerignore").read_text(encoding="utf-8").split()
    steps = container.steps((ROOT / "Dockerfile").read_text(encoding="utf-8"))
    wanted = {name for word, rest in steps if word == "COPY" for name in rest.split()[:-1]}
    assert wanted == {line.removeprefix("!") for line in allowed if line.startswith("!")}


def test_no_workflow_has_a_secret_or_may_write_but_to_the_index() -> None:
    workflows = tracked(".github/workflows", ".yml")
    assert len(workflows) > 1
    for path in workflows:
        text = path.read_text(encoding="utf-8")
        assert "secrets." not in text
        assert re.findall(r"^ *([\w-]+): write", text, re.MULTILINE) in ([], ["id-token"])
        assert re.search(r"^permissions:\n  contents: read$", text, re.MULTILINE)
