"""The verb `leaderboard` says what it found, and writes the pages."""

from pathlib import Path

import pytest

from tests.cli.conftest import Told, refusal


@pytest.mark.slow
def test_leaderboard_of_a_bundle(tmp_path: Path, told: Told) -> None:
    run, folder, out = tmp_path / "run", tmp_path / "bundles", tmp_path / "site"
    words = ["--tasks", "bin_sort", "--episodes", "1", "--videos", "0", "--workers", "0"]
    told("eval", "--policy", "hold", "--out", run, *words)
    told("bundle", run, "--out", folder / "hold.duobench.zip")
    (folder / "bad.duobench.zip").write_text("nothing")
    said = told("leaderboard", folder, "--out", out, "--workers", "0")
    assert "Verifying hold.duobench.zip\n" in said
    assert "Not ranked: hold, success 0.0 % (0.0–79.3) of 1 episode; 1 of 11 tasks; " in said
    assert "Refused: bad.duobench.zip: " in said
    assert f"Leaderboard: {out / 'index.html'}, 1 policy run" in said
    assert "Verifying" not in told("leaderboard", folder, "--out", out)


def test_folder_with_something_else_is_left_alone(tmp_path: Path) -> None:
    site = tmp_path / "site"
    (tmp_path / "x.duobench.zip").write_text("nothing")
    site.mkdir()
    (site / "thesis.tex").write_text("precious")
    assert "Give --out another folder" in refusal("leaderboard", tmp_path, "--out", site)
