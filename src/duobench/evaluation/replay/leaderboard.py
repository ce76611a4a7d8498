"""A leaderboard of bundles, each of which is verified before it is shown.

What a bundle is found to be is kept by its checksum, so that only new ones are played again.
"""

import hashlib
import json
import platform
from collections import Counter
from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from duobench.core.errors import DataError, DuoBenchError, EvaluationError, FileError, escaped
from duobench.core.files import digest_of, encode, locked, read, remove, write
from duobench.core.randomness import SUITE_VERSION
from duobench.core.versions import has_avx2, package_source, package_versions
from duobench.data.processes import Progress
from duobench.evaluation.replay.verify import Finding, Verdict, Verification, verify
from duobench.results.bundle import MAX_BYTES, Bundle
from duobench.results.leaderboard import (
    VERDICTS,
    Board,
    BoardEntry,
    RefusedBundle,
    begin_site,
    counting,
    make_entry,
    write_site,
)
from duobench.results.records import RECORD_SCHEMA, Key
from duobench.results.run import RUN_SCHEMA
from duobench.results.salt import ROUNDS, Round, Salt, read_rounds

JUDGEMENT_SCHEMA = 3
_SHOWN = 3
_LONGEST_REASON = 600
_LONGEST_COMMAND, _MOST_COMMANDS = 2000, 20


@dataclass(frozen=True, kw_only=True, slots=True)
class Judgement:
    """What was found out about a bundle; it is kept for the next time."""

    CHECKED_FROM: ClassVar[int] = JUDGEMENT_SCHEMA
    """First schema whose files hold a checksum."""
    verified_by: dict[str, str]
    """What decides a verification: versions, and the kind of processor."""
    reason: str
    """Why the bundle is refused, in one line; empty if it is not."""
    verdicts: dict[str, int]
    unverifiable: tuple[Key, ...]
    """Names of episodes that cannot be played again."""


class _RefusedError(Exception):
    """A bundle is refused; the message is the reason."""


Started = Callable[[str], Progress]
"""Told the name of a bundle that is going to be verified; gives what is told about its progress."""


def make_leaderboard(
    folder: Path,
    out: Path,
    *,
    workers: int = 0,
    started: Started = lambda _name: lambda _done, _total: None,
) -> tuple[Board, Path]:
    """Verify the bundles in a folder, and write the pages of a leaderboard.

    Args:
        folder: Folder with bundles, files whose names end in `.zip`, and the `ROUNDS` of their
            organiser, if any; no folder in it is looked into.
        out: Folder of the leaderboard; an earlier one in it is replaced, and what it knows about
            bundles is used.
        workers: Processes that verify side by side; 0 verifies in this process.
        started: Told which bundle is verified; those that were verified before are not.

    Returns:
        The leaderboard, and its first page.
    """
    files = filter(Path.is_file, folder.glob("*"))
    paths = sorted(path for path in files if path.suffix.lower() == ".zip")
    if not paths:
        raise EvaluationError(f"There is no bundle in {folder}: no file whose name ends in .zip.")
    rounds = read_rounds(folder / ROUNDS) if (folder / ROUNDS).exists() else ()
    begin_site(out)
    entries: dict[str, BoardEntry] = {}
    refused: list[RefusedBundle] = []
    known: set[str] = set()
    runs: dict[str, str] = {}
    with locked(out):
        for path in paths:
            try:
                digest = _digest(path)
                known.add(digest)
                entries[digest] = _entry(path, digest, runs, out, workers, started, rounds)
            except (_RefusedError, DuoBenchError, OSError) as error:
                refused.append(
                    RefusedBundle(file=escaped(path.name), reason=_line(str(error), path))
                )
        board = Board(entries=tuple(entries.values()), refused=tuple(refused), rounds=rounds)
        page = write_site(board, out)
        verdicts = (out / VERDICTS).glob("*.json")
        remove(*(path for path in verdicts if path.stem not in known))
    return board, page


def _entry(
    path: Path,
    digest: str,
    runs: dict[str, str],
    out: Path,
    workers: int,
    started: Started,
    rounds: Sequence[Round],
) -> BoardEntry:
    """The entry of a bundle, or a `_RefusedError` if it counts for nothing.

    The file of a run is noted by the SHA-256 of all that is shown of it.
    """
    bundle = Bundle(path)
    if _digest(path) != digest:
        raise _RefusedError("It was changed while it was read.")
    run = bundle.read_run()
    foreign = run.suite.foreign
    if foreign:
        raise _RefusedError(f"It has a task that is none of the benchmark: {foreign[0]}.")
    if len(run.candidates) > 1:
        raise _RefusedError("It holds several policies; a bundle of a leaderboard holds one.")
    hosted = next((each for each in rounds if digest in each.bundles), None)
    if hosted and hosted.salt_sha256 != run.suite.salt:
        raise _RefusedError(f"Round {hosted.name!r} names it, and has another salt.")
    salts = (each.salt for each in rounds if each.salt_sha256 == run.suite.salt)
    bundle.salt = Salt(salt) if (salt := next(salts, None)) else None
    counts = counting(run)
    records = bundle.read_records(run, counts)
    noted = bundle.attempts().keys()
    # A copy of which anything else would be shown must not take the place of the run.
    about = hosted and hosted.name, bundle.commands(), bundle.attempts(), encode(run, RUN_SCHEMA)
    texts = [json.dumps(about), *(encode(record, RECORD_SCHEMA) for record in records)]
    content = hashlib.sha256("\n".join(texts).encode()).hexdigest()
    twin = runs.get(content)
    if twin:
        raise _RefusedError(f"It holds the same run as {twin}.")
    kept = out / VERDICTS / f"{digest}.json"
    judgement = _known(kept, bundle.salt)
    if judgement is None:
        judgement = _judge(bundle, counts, workers, started(escaped(path.name)))
        write(kept, encode(judgement, JUDGEMENT_SCHEMA))
    if judgement.reason:
        raise _RefusedError(judgement.reason)
    for record in records:
        if record.error is None and record.key in judgement.unverifiable:
            raise _RefusedError(
                f"{record.task}, episode {record.episode} cannot be verified, though no error "
                "ended it."
            )
    runs[content] = escaped(path.name)
    return make_entry(
        escaped(path.name),
        digest,
        run,
        records,
        judgement.verdicts,
        judgement.unverifiable,
        noted=noted,
        commands=[each[:_LONGEST_COMMAND] for each in bundle.commands()[:_MOST_COMMANDS]],
        hosted=hosted,
    )


def _known(path: Path, salt: Salt | None) -> Judgement | None:
    """What was found out before in the same way; None if nothing was."""
    if not path.exists():
        return None
    try:
        judgement = read(path, Judgement, JUDGEMENT_SCHEMA)
    except FileError:
        return None
    return judgement if judgement.verified_by == _here(salt) else None


def _here(salt: Salt | None) -> dict[str, str]:
    return {
        "salt": salt.sha256 if salt else "",
        **package_versions(),
        "suite": SUITE_VERSION,
        "source": package_source(),
        "machine": platform.machine(),
        "avx2": str(has_avx2()),
    }


def _judge(bundle: Bundle, wanted: Set[Key], workers: int, progress: Progress) -> Judgement:
    """Verify a bundle, or raise a `_RefusedError` if it ended the process that verified it."""
    findings: Sequence[Finding] = ()
    try:
        found = verify(bundle, wanted=wanted, workers=workers, progress=progress)
        findings, reason = found.findings, _objection(found)
    except DataError as error:
        raise _RefusedError(f"It could not be verified: {error}") from error
    except DuoBenchError as error:
        reason = str(error)
    counts = Counter(each.verdict for each in findings)
    return Judgement(
        verified_by=_here(bundle.salt),
        reason=_line(reason, bundle.path),
        verdicts={str(verdict): counts[verdict] for verdict in Verdict},
        unverifiable=tuple(each.key for each in findings if each.verdict is Verdict.UNVERIFIABLE),
    )


def _objection(found: Verification) -> str:
    """Why a bundle is refused; empty if it is not."""
    what = [
        *found.objections,
        *(
            f"{each.key.task}, episode {each.key.episode}: {each.reason}"
            for each in found.of(Verdict.CONTRADICTED)
        ),
    ]
    if what:
        more = f" And {len(what) - _SHOWN} more." if len(what) > _SHOWN else ""
        return f"Contradicted. {' '.join(what[:_SHOWN])}{more}"
    if found.is_verified:
        return ""
    reasons = [each.reason for each in found.of(Verdict.UNVERIFIABLE)]
    return f"Nothing in it can be verified. {reasons[0] if reasons else 'It has no episode.'}"


def _line(reason: str, path: Path) -> str:
    """A reason in one line, without the place of the file on this machine."""
    for place in (path.absolute(), path):
        reason = reason.replace(str(place), path.name)
    line = " ".join(escaped(reason).split())
    return line if len(line) <= _LONGEST_REASON else f"{line[:_LONGEST_REASON]}…"


def _digest(path: Path) -> str:
    """The SHA-256 of a file that is not too large for a bundle."""
    if path.stat().st_size > MAX_BYTES:
        raise FileError(f"It is larger than {MAX_BYTES} bytes.")
    return digest_of(path)
