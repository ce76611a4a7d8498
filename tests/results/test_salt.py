"""A salt: what follows from it, and where it is not; and the rounds in which it is published."""

import hashlib
import hmac
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from duobench.core.errors import EvaluationError, OutputError
from duobench.core.randomness import SALTED
from duobench.envs.config import EnvConfig
from duobench.results.salt import Round, Salt, make_salt, read_rounds, read_salt
from tests.results.samples import sample_run

DIGITS = "0123456789abcdef" * 4
SALT, OTHER = Salt(DIGITS), Salt("ab" * 32)


def test_seeds_are_those_of_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("duobench.results.salt.SUITE_VERSION", "5")
    expected = [
        int.from_bytes(hmac.digest(bytes.fromhex(DIGITS), text.encode(), "sha256")[-4:], "big")
        for text in ("episode\x1fbin_sort\x1f5\x1f3", "policy\x1fbin_sort\x1f5\x1f3")
    ]
    assert list(SALT.seeds("bin_sort", 3)) == expected == [2818045875, 4154739257]
    monkeypatch.setattr("duobench.results.salt.SUITE_VERSION", "6")
    assert set(SALT.seeds("bin_sort", 3)).isdisjoint(expected)


def test_seeds_are_distinct_and_unrelated() -> None:
    pairs = [
        salt.seeds(task, index)
        for salt in (SALT, OTHER)
        for task in ("bin_sort", "carry_pot")
        for index in range(1000)
    ]
    episodes, policies = np.array(pairs).T / 2**32
    assert len({seed for pair in pairs for seed in pair}) == 8000
    for seeds in (episodes, policies):
        assert stats.kstest(seeds, "uniform").pvalue > 0.01
    assert abs(stats.pearsonr(episodes, policies).statistic) < 0.05


def test_a_new_salt_is_its_owners_alone_and_stays(tmp_path: Path) -> None:
    path = tmp_path / "salt"
    assert make_salt(path)
    content = path.read_bytes()
    assert (len(content), path.stat().st_mode & 0o777) == (65, 0o600)
    assert read_salt(path).sha256 == hashlib.sha256(bytes.fromhex(content.decode())).hexdigest()
    assert not make_salt(path)
    assert path.read_bytes() == content
    with pytest.raises(OutputError, match="there is no folder "):
        make_salt(tmp_path / "nowhere" / "salt")


@pytest.mark.parametrize("text", [DIGITS, f" {DIGITS.upper()}\r\n", f"{DIGITS * 2}\n"])
def test_a_salt_is_read_as_people_write_it(text: str, tmp_path: Path) -> None:
    path = tmp_path / "salt"
    path.write_text(text, newline="")
    assert read_salt(path).digits == text.strip().lower()


@pytest.mark.parametrize(
    "content", [b"", b"my secret salt", DIGITS[1:].encode(), b"\xffsecret", f"x{DIGITS}".encode()]
)
def test_what_is_no_salt_is_refused_and_not_shown(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(content)
    with pytest.raises(EvaluationError, match="it has no 64 hexadecimal digits") as caught:
        read_salt(path)
    assert caught.value.__suppress_context__
    assert "secret" not in str(caught.value)
    assert DIGITS[1:] not in str(caught.value)
    with pytest.raises(EvaluationError, match="No such file"):
        read_salt(tmp_path / "nothing")


def test_no_text_of_a_salt_has_its_digits() -> None:
    assert DIGITS not in f"{SALT!r} {SALT} {SALT.seeds('bin_sort', 0)}"


@pytest.mark.parametrize(
    ("salt", "split"), [(None, SALTED), ("", SALTED), (SALT.sha256, "eval"), (SALT.sha256, "train")]
)
def test_a_run_has_a_salt_in_the_salted_split_alone(salt: str | None, split: str) -> None:
    config = EnvConfig(cameras=(), split=split)
    with pytest.raises(EvaluationError, match="'salted', and no other, names its salt"):
        sample_run(config=config, salt=salt)


# --- rounds --------------------------------------------------------------------------------------

AUTUMN = f"""
[[round]]
name = "autumn"
date = 2026-09-01
salt_sha256 = "{SALT.sha256}"
"""
SPRING = AUTUMN.replace("autumn", "spring").replace(SALT.sha256, OTHER.sha256)
BUNDLE = f'bundles = ["{"c" * 64}"]\n'


def rounds(text: str, folder: Path) -> tuple[Round, ...]:
    path = folder / "rounds.toml"
    path.write_text(text)
    return read_rounds(path)


def test_rounds_are_read(tmp_path: Path) -> None:
    autumn, spring = rounds(f'{AUTUMN}{BUNDLE}salt = "{DIGITS.upper()}"\n{SPRING}', tmp_path)
    assert (autumn.name, autumn.date, autumn.salt) == ("autumn", date(2026, 9, 1), DIGITS)
    assert (autumn.bundles, spring.bundles, spring.salt) == (("c" * 64,), (), None)
    assert rounds(AUTUMN.replace("2026-09-01", '"2026-09-01"'), tmp_path)[0].date == autumn.date


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (AUTUMN + AUTUMN.replace("autumn", "spring"), f"{SALT.sha256} is there twice"),
        (AUTUMN + SPRING.replace("spring", "autumn"), "autumn is there twice"),
        (AUTUMN + BUNDLE + SPRING + BUNDLE, f"{'c' * 64} is there twice"),
        (AUTUMN + f'salt = "{OTHER.digits}"', "The salt of 'autumn' does not have its SHA-256"),
        (AUTUMN + 'salt = "abc"', "64 hexadecimal digits"),
        (AUTUMN + 'salt = ""', "64 hexadecimal digits"),
        (AUTUMN + 'slat = "abc"', "unknown field `slat`"),
        (AUTUMN + 'bundles = ["abc"]', "matching regex"),
        (AUTUMN.replace("2026-09-01", "'soon'"), "Invalid RFC3339"),
        (AUTUMN.replace("name", "nam"), "missing required field `name`|unknown field `nam`"),
        (AUTUMN.replace("[[round]]", "[round]"), "Expected `array`"),
        ("", "round"),
        ("round = [", "Invalid value"),
        ("round = 1", "Expected `array`"),
    ],
)
def test_rounds_that_are_none_are_refused_in_a_sentence(
    text: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(EvaluationError, match=words) as caught:
        rounds(text, tmp_path)
    assert str(caught.value).startswith(f"Cannot read the rounds in {tmp_path}")
