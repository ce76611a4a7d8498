"""Write the table of tasks in README.md; part of `make docs`."""

from pathlib import Path

from duobench.tasks import catalog

README = Path(__file__).parents[1] / "README.md"
BEGIN = "<!-- tasks: written by make docs -->\n"
END = "<!-- end of tasks -->\n"


def table() -> str:
    """Return the tasks as a table in Markdown."""
    rows = ["| task | category | stages | horizon |", "| --- | --- | --- | --- |"]
    for task in map(catalog.get, catalog.names()):
        rows.append(f"| `{task.id}` | {task.category} | {task.max_stage} | {task.horizon} |")
    return "\n".join(rows) + "\n"


def with_table(page: str) -> str:
    """Return a page with the table between its marks brought up to date."""
    before, rest = page.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n{table()}\n{END}{after}"


if __name__ == "__main__":
    README.write_text(with_table(README.read_text(encoding="utf-8")), encoding="utf-8")
