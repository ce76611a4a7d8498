"""The page on comparing runs: its command works, and its coverage is that of the intervals."""

import shlex
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

from duobench.cli import main
from duobench.results.scores import wilson_interval
from tests.docs.markdown import DOCS, blocks, table
from tests.results.outcomes import play

PAGE = DOCS / "comparison.md"


def test_the_command_writes_what_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, stage in (("small", 1), ("large", 2)):
        play(tmp_path / "runs" / name, {"carry_pot": [stage] * 3})
    (line,) = blocks(PAGE, "sh")
    program, *words = shlex.split(line)
    assert program == "duobench"
    main(words)
    written = {path.name for path in (tmp_path / "runs" / "compared").iterdir()}
    assert written == {
        *("index.html", "comparison.json", "table.md", "table.csv", "table.tex", "figures"),
    }


def test_coverage_of_wilson_is_that_of_the_page() -> None:
    """It is lowest beside an end of one of the intervals."""
    rows = [row for row in table(PAGE, "interval") if row["interval"] == "Wilson"]
    assert {row["episodes"] for row in rows} == {"20", "100"}
    for row in rows:
        n = int(row["episodes"])
        ends = np.array([wilson_interval(k, n) for k in range(n + 1)])
        beside = np.concatenate([ends.ravel() - 1e-9, ends.ravel() + 1e-9])
        at = beside[(beside > 0) & (beside < 0.5)]
        lowest = coverage(ends, at)
        everywhere = coverage(ends, (np.arange(2000) + 0.5) / 2000)
        assert row["mean"] == f"{np.mean(everywhere):.1f} %"
        assert row["lowest"] == f"{np.min(lowest):.1f} %"
        assert row["where"].startswith(f"success rate {100 * at[np.argmin(lowest)]:.1f} %")


def coverage(ends: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """How often in percent the intervals (n + 1, 2) of 0..n successes hold each true rate."""
    counts = np.arange(len(ends))[:, None]
    covered = (ends[:, :1] <= rates) & (rates <= ends[:, 1:])
    return 100 * np.sum(binom.pmf(counts, len(ends) - 1, rates) * covered, axis=0)
