"""The verb `leaderboard` says what it found, and writes the pages."""

from pathlib import Path

import pytest

from duobench.cli import main


def test_leaderboard_of_a_bundle(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run, folder, out = tmp_path / "run", tmp_path / "bundles", tmp_path / "site"
    words = ["--tasks", "bin_sort", "--episodes", "1", "--videos", "0", "--workers", "0"]
    main(["eval", "--policy", "hold", "--out", str(run), *words])
    main(["bundle", str(run), "--out", str(folder / "hold.duobench.zip")])
    (folder / "bad.duobench.zip").write_text("nothing")
    capsys.readouterr()
    main(["leaderboard", str(folder), "--out", str(out), "--workers", "0"])
    said = capsys.readouterr().out
    assert "Verifying hold.duobench.zip\n" in said
    assert "Not ranked: hold, success 0.0 % (0.0–79.3) of 1 episode; 1 of 11 tasks; " in said
    assert "Refused: bad.duobench.zip: " in said
    assert f"Leaderboard: {out / 'index.html'}, 1 policy run" in said
    main(["leaderboard", str(folder), "--out", str(out)])
    assert "Verifying" not in capsys.readouterr().out


def test_mistakes_are_said(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="There is no folder"):
        main(["leaderboard", str(tmp_path / "none"), "--out", str(tmp_path / "site")])
    with pytest.raises(SystemExit, match="There is no bundle in"):
        main(["leaderboard", str(tmp_path), "--out", str(tmp_path / "site")])
    (tmp_path / "x.duobench.zip").write_text("nothing")
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "thesis.tex").write_text("precious")
    with pytest.raises(SystemExit, match="Give --out another folder"):
        main(["leaderboard", str(tmp_path), "--out", str(tmp_path / "site")])
