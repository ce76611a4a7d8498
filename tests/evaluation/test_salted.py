"""Evaluations with a salt: what a policy with a table gets, where the salt is, and who goes on."""

import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from duobench.cli import main
from duobench.core.errors import EvaluationError, OtherRunError
from duobench.core.randomness import episode_seed, policy_seed
from duobench.data import DataSet
from duobench.evaluation.replay.leaderboard import make_leaderboard
from duobench.evaluation.replay.verify import Verdict, verify
from duobench.evaluation.runners.evaluate import evaluate, record as record_demonstrations
from duobench.evaluation.runners.process import WorkerProcess
from duobench.policy import HoldPolicy
from duobench.results.bundle import Bundle, open_source, write_bundle
from duobench.results.folder import RunFolder
from duobench.results.records import EpisodeRecord
from duobench.results.report import write_report
from duobench.results.run import Shard
from duobench.results.salt import Salt, read_salt
from duobench.results.suite import Suite, find_tasks
from duobench.tasks import catalog
from tests.children import ran
from tests.cli.conftest import refusal
from tests.evaluation.conftest import compared
from tests.evaluation.forging import copied, redescribed, rewritten
from tests.results.samples import key

SALT, OTHER = Salt("5a" * 32), Salt("0123456789abcdef" * 4)
TASK = "bin_sort"
TABLE = "DUOBENCH_TEST_TABLE"


class Remembers(HoldPolicy):
    """Plays stored joint targets back that belong to its seed, and holds where it has none."""

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        with np.load(os.environ[TABLE]) as table:
            self.stored = table.get(str(seed))

    def act(self, observation: Mapping[str, Any]) -> Any:
        held = super().act(observation)
        return held if self.stored is None else self.stored


def played(folder: Path, policy: str, episodes: int = 2, **options: Any) -> list[EpisodeRecord]:
    suite = Suite(tasks=find_tasks([TASK]), episodes=episodes)
    arguments = {"workers": 0} | options
    results = evaluate(policy, suite, RunFolder(folder), **arguments)
    return [record for one in results.tasks for record in one.records]


@pytest.fixture(scope="module")
def hold(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """Two episodes with the first salt."""
    folder = tmp_path_factory.mktemp("salted") / "run"
    played(folder, "hold", salt=SALT)
    return RunFolder(folder)


@pytest.fixture
def run(hold: RunFolder, tmp_path: Path) -> RunFolder:
    """A copy of it."""
    return copied(hold, tmp_path / "copy")


def test_a_table_of_public_seeds_gets_all_there_and_what_hold_gets_here(
    tmp_path, monkeypatch, hold
):
    experts = played(tmp_path / "expert", "expert")
    table = tmp_path / "table.npz"
    np.savez(table, **{str(each.policy_seed): each.targets() for each in experts})
    monkeypatch.setenv(TABLE, str(table))
    policy = f"{__name__}:Remembers"
    public = played(tmp_path / "public", policy)
    assert [each.success for each in public] == [each.success for each in experts] == [True] * 2
    salted = played(tmp_path / "hosted", policy, salt=SALT)
    held = hold.read_records(hold.read_run())
    assert [each.end for each in salted] == [each.end for each in held]
    assert [each.final_stage for each in salted] == [0, 0]


def test_no_salted_seed_of_a_policy_is_in_the_table_of_public_ones():
    names = catalog.names()
    table = {policy_seed(task, episode_seed(task, n)) for task in names for n in range(100)}
    salted = [SALT.seeds(task, n) for task in names for n in range(100)]
    assert len(table) == 1100
    assert table.isdisjoint(seed for seeds in salted for seed in seeds)
    # The policy's seed is no hash of the episode's, as it is in the public splits.
    assert all(policy_seed(TASK, seed, "salted") != hashed for seed, hashed in salted)


def test_records_have_the_seeds_of_the_salt_in_every_process_and_shard(hold, tmp_path):
    records = hold.read_records(hold.read_run())
    assert [(each.seed, each.policy_seed) for each in records] == [
        SALT.seeds(TASK, 0),
        SALT.seeds(TASK, 1),
    ]
    assert {each.config.split for each in records} == {"salted"}
    for number in (1, 2):
        played(tmp_path / "parts", "hold", salt=SALT, workers=1, shard=Shard.parse(f"{number}/2"))
    assert compared(RunFolder(tmp_path / "parts")) == compared(hold)


# --- where the salt is ---------------------------------------------------------------------------


class Searches(HoldPolicy):
    """Fails if the salt is in anything that it gets, or in any process that it can look into."""

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        places = [*Path("/proc").glob("[0-9]*/cmdline"), *Path("/proc").glob("[0-9]*/environ")]
        for path in places:
            try:
                content = path.read_bytes()
            except OSError:  # a process that has ended
                continue
            if has_salt(content):
                raise RuntimeError(f"It is in {path}.")
        if has_salt(f"{instruction} {seed}".encode()):
            raise RuntimeError("It was told.")


def has_salt(content: bytes) -> bool:
    return OTHER.digits.encode() in content.lower() or bytes.fromhex(OTHER.digits) in content


def test_the_salt_is_nowhere_but_in_its_file(tmp_path):
    (tmp_path / "round.salt").write_text(OTHER.digits)
    out = tmp_path / "run"
    words = ["--tasks", TASK, "--episodes", "2", "--videos", "1", "--workers", "2"]
    command = ["eval", "--policy", f"{__name__}:Searches", "--out", str(out), *words]
    done = ran("-m", "duobench", *command, "--salt", str(tmp_path / "round.salt"))
    assert done.returncode == 0, done.stdout + done.stderr
    reader = RunFolder(out)
    assert [each.error for each in reader.read_records(reader.read_run())] == [None] * 2
    assert reader.read_run().suite.salt == OTHER.sha256
    assert [each.split(" --salt ")[1].split()[0] for each in reader.commands()] == ["FILE"]
    write_bundle(reader, tmp_path / "run.duobench.zip")
    with zipfile.ZipFile(tmp_path / "run.duobench.zip") as archive:
        parts = [archive.read(name) for name in archive.namelist()]
    files = [path.read_bytes() for path in out.rglob("*") if path.is_file()]
    said = (done.stdout + done.stderr).encode()
    assert len(files) > 5
    assert not any(map(has_salt, [*parts, *files, said]))
    assert any(OTHER.sha256.encode() in each for each in parts)


def test_workers_and_policies_are_sent_seeds_alone(tmp_path, monkeypatch):
    sent: list[bytes] = []
    send = WorkerProcess.send

    def noting(process: WorkerProcess, request: Any) -> None:
        sent.append(msgspec.json.encode(request))
        send(process, request)

    monkeypatch.setattr(WorkerProcess, "send", noting)
    played(tmp_path / "run", f"{__name__}:Searches", salt=OTHER, workers=1)
    text = b"".join(sent)
    assert str(OTHER.seeds(TASK, 1)[0]).encode() in text
    assert not has_salt(text)


# --- going on, and reading -----------------------------------------------------------------------


def test_a_run_goes_on_with_its_own_salt_alone(run):
    for salt, words in ((None, "salt none instead of "), (OTHER, f"salt {OTHER.sha256} instead")):
        with pytest.raises(OtherRunError, match=words):
            played(run.path, "hold", 3, salt=salt)
    assert len(played(run.path, "hold", 3, salt=SALT)) == 3
    public = run.path.with_name("public")
    played(public, "hold")
    with pytest.raises(OtherRunError, match=f"salt {SALT.sha256} instead of none"):
        played(public, "hold", salt=SALT)


def test_a_run_with_a_salt_needs_it_for_its_episodes(hold):
    with pytest.raises(EvaluationError, match="no seeds without a salt"):
        [episode.seed for episode in hold.read_run().episodes()]


def test_readers_do_without_the_salt(run, tmp_path):
    write_bundle(run, tmp_path / "run.duobench.zip")
    out = RunFolder(tmp_path / "report")
    write_report(out, Bundle(tmp_path / "run.duobench.zip"))
    page = out.page.read_text()
    assert f"SHA-256 {SALT.sha256}" in page
    assert "layouts of the split salted" in " ".join(page.split())
    main(["compare", str(run.path), str(tmp_path / "run.duobench.zip"), "--out", f"{tmp_path}/c"])
    main(["report", str(run.path), "--replays", f"{TASK}:0"])
    assert list(run.path.glob("replays/**/*.track"))


# --- verification --------------------------------------------------------------------------------


def verdicts(source: Any, salt: Salt | None) -> list[Verdict]:
    source.salt = salt
    return [finding.verdict for finding in verify(source).findings]


def forged(run: RunFolder) -> RunFolder:
    """As its author says it was played with another salt than it was."""
    redescribed(run, lambda document: document["suite"].update(salt=OTHER.sha256))
    return run


def test_seeds_are_verified_against_the_salt(run, tmp_path):
    path = tmp_path / "run.duobench.zip"
    write_bundle(run, path)
    for source in (run, open_source(path)):
        assert verdicts(source, None) == verdicts(source, SALT) == [Verdict.EXACT] * 2
        with pytest.raises(OtherRunError, match=f"salt is {OTHER.sha256}; the run"):
            verdicts(source, OTHER)
    forged(run)
    assert verdicts(run, None) == [Verdict.EXACT] * 2
    assert verdicts(run, OTHER) == [Verdict.CONTRADICTED] * 2
    assert f"its seed is {SALT.seeds(TASK, 0)[0]}, expected was" in verify(run).findings[0].reason


def test_another_seed_of_the_policy_is_found_by_whoever_has_the_salt(run):
    """That of the layout, for a policy that makes it again; no replay shows what a policy got."""
    first = run.record(key(run, TASK, 0))
    rewritten(first, lambda record: record.update(policy_seed=record["seed"]))
    assert verdicts(run, None) == [Verdict.EXACT] * 2
    assert verdicts(run, SALT) == [Verdict.CONTRADICTED, Verdict.EXACT]
    assert "its policy_seed is" in verify(run).findings[0].reason
    with pytest.raises(EvaluationError, match="its policy_seed is"):
        played(run.path, "hold", 3, salt=SALT)


def test_the_command_says_that_seeds_are_not_verified(run, tmp_path, capsys):
    def told(*words: object) -> str:
        main(list(map(str, words)))
        return capsys.readouterr().out

    (tmp_path / "salt").write_text(SALT.digits)
    (tmp_path / "other").write_text(OTHER.digits)
    said = told("verify", run.path)
    assert "The seeds are not verified" in said
    assert said.endswith("Verified.\n")
    assert "seeds are not" not in told("verify", run.path, "--salt", tmp_path / "salt")
    assert OTHER.sha256 in refusal("verify", run.path, "--salt", tmp_path / "other")
    missing = refusal("verify", run.path, "--salt", tmp_path / "nothing")
    assert "No such file" in missing


def test_the_command_makes_a_salt_and_never_writes_over_anything(tmp_path, capsys):
    path = tmp_path / "round.salt"
    for word in ("new", "there before and not changed"):
        main(["salt", str(path)])
        said = capsys.readouterr().out
        assert f"round.salt, {word}: {read_salt(path).sha256}" in said
        assert path.read_text().strip() not in said
    (tmp_path / "thesis.tex").write_text("precious")
    assert "it has no 64 hexadecimal digits" in refusal("salt", tmp_path / "thesis.tex")
    assert (tmp_path / "thesis.tex").read_text() == "precious"
    words = ("--policy", "hold", "--tasks", TASK, "--out", tmp_path / "run")
    assert "No such file" in refusal("eval", *words, "--salt", tmp_path / "nothing")
    assert not (tmp_path / "run").exists()


def test_demonstrations_are_never_of_the_salted_split(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["record", "--split", "salted", "--out", str(tmp_path / "data")])
    assert "invalid choice 'salted'" in capsys.readouterr().err
    data = DataSet.open(tmp_path / "data")
    with pytest.raises(EvaluationError, match="and no other, names its salt"):
        record_demonstrations("hold", find_tasks([TASK]), data, episodes=1, split="salted")


def test_a_public_run_has_no_salt_to_verify(tmp_path):
    played(tmp_path / "run", "hold", 1)
    with pytest.raises(OtherRunError, match="the run says no salt"):
        verdicts(RunFolder(tmp_path / "run"), SALT)


# --- rounds --------------------------------------------------------------------------------------


def round_of(salt: Salt, digest: str, more: str = "") -> str:
    return (
        f'[[round]]\nname = "{salt.digits[:2]}"\ndate = 2026-09-01\n'
        f'salt_sha256 = "{salt.sha256}"\nbundles = ["{digest}"]\n{more}\n'
    )


def test_a_round_is_verified_once_its_salt_is_out(run, tmp_path):
    bundles, out = tmp_path / "bundles", tmp_path / "site"
    honest, bad = bundles / "honest.duobench.zip", bundles / "forged.duobench.zip"
    write_bundle(run, honest)
    write_bundle(forged(run), bad)
    verified: list[str] = []

    def made(rounds: str) -> Any:
        (bundles / "rounds.toml").write_text(rounds)
        verified.clear()
        board, _ = make_leaderboard(
            bundles, out, started=lambda name: (verified.append(name), lambda _a, _b: None)[1]
        )
        entries = {one.file: one for one in board.entries}
        return entries, {one.file: one.reason for one in board.refused}

    first, _ = made("round = []")
    digests = {name: one.digest for name, one in first.items()}
    assert all("self-reported" in " ".join(one.lacks) for one in first.values())
    hosted = round_of(SALT, digests[honest.name])
    theirs = round_of(OTHER, digests[bad.name])
    entries, refused = made(hosted + theirs)
    assert (verified, refused) == ([], {})  # what is known of them is that of no salt
    assert [one.hosted and one.hosted.name for one in entries.values()] == ["01", "5a"]
    published = round_of(SALT, digests[honest.name], f'salt = "{SALT.digits}"')
    published += round_of(OTHER, digests[bad.name], f'salt = "{OTHER.digits}"')
    entries, refused = made(published)
    assert verified == [honest.name]  # the other one is told by its seeds alone
    assert list(entries) == [honest.name]
    assert "its seed is" in refused[bad.name]
    assert made(published)[1] == refused
    assert verified == []
    entries, refused = made(round_of(SALT, digests[bad.name]))
    assert "names it, and has another salt" in refused[bad.name]
    assert "self-reported" in " ".join(entries[honest.name].lacks)
