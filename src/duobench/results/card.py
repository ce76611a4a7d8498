"""The card of a checkpoint: what it reached, and the bundle of the evaluation that says so."""

import io
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

from duobench.core.errors import EvaluationError
from duobench.core.files import digest_of, write
from duobench.core.lerobot_keys import CARD, check_card, in_cell
from duobench.core.pages import render
from duobench.policy.lerobot_checkpoint import CONFIG, WEIGHTS, content_hash, read
from duobench.results.bundle import BUNDLE_SUFFIX, Bundle, open_source, write_bundle
from duobench.results.figures import stage_bars
from duobench.results.report import read_parts
from duobench.results.scores import interval_percent, percent, progress_text
from duobench.results.suite import conditions_text, suite_options

EVALUATION = f"evaluation{BUNDLE_SUFFIX}"
FIGURE = "stages.png"
TRAINING = "training.json"
"""Names and values of a training, which a checkpoint that is none of LeRobot may have beside it."""
_HASH = 16  # digits of a SHA-256 that name weights in the version of a policy


def write_checkpoint_card(folder: Path, source: Path, name: str, licence: str) -> Path:
    """Write the card of a checkpoint, a figure and the bundle of a run into its folder.

    Raises:
        OptionError: The Hub takes no such name or licence.
        EvaluationError: The run is none of this checkpoint alone: the version of its policy names
            no file of the folder by its SHA-256; or it is of several policies or conditions; or it
            is not finished.
    """
    check_card(name, licence)
    reader = open_source(source)
    part, *others = read_parts(reader)
    if others:
        raise EvaluationError(
            f"{source} has {len(others) + 1} policies or conditions, and a card is about one: "
            "evaluate the checkpoint under one."
        )
    version = part.candidate.metadata.version or "not known"
    if not any(digest in version for digest in _digests(folder)):
        raise EvaluationError(
            f"{source} is no evaluation of {folder} alone: the version of its policy is "
            f"{version}, which names no file of that folder by its SHA-256."
        )
    left = part.size - part.results.overall.episodes
    if left:
        raise EvaluationError(f"{source} lacks {left} of {part.size} episodes: finish it first.")
    bundle = folder / EVALUATION
    if not isinstance(reader, Bundle):
        write_bundle(reader, bundle)
    elif not bundle.exists() or not bundle.samefile(source):
        write(bundle, source.read_bytes())
    figure: Any = stage_bars(part.results)
    figure.savefig(png := io.BytesIO(), format="png", dpi=160, facecolor="white")
    write(folder / FIGURE, png.getvalue())
    is_lerobot, policy = (folder / CONFIG).exists(), part.candidate.policy
    if is_lerobot:
        policy = f"lerobot:checkpoint{_settings(policy)}"
    own = part.suite.foreign
    words = ["--policy", policy, *suite_options(part.suite)]
    text = render(
        "duobench.results",
        "card.md.j2",
        id=name,
        licence=licence,
        is_lerobot=is_lerobot,
        command=shlex.join(["duobench", "eval", *words]),
        own=own,
        asked=" --import-tasks" if own else "",
        conditions=conditions_text(part.suite),
        part=part,
        percent=percent,
        interval=interval_percent,
        progress=progress_text,
        figure=FIGURE,
        training={in_cell(key): in_cell(of) for key, of in _training(folder).items()},
        bundle=EVALUATION,
        digest=digest_of(bundle),
    )
    write(folder / CARD, text)
    return folder / CARD


def _settings(policy: str) -> str:
    """What stands behind the path of a policy of LeRobot, but for where it computes."""
    words = policy.partition("?")[2].split("&")
    chosen = "&".join(word for word in words if word and not word.startswith("device="))
    return chosen and f"?{chosen}"


def _digests(folder: Path) -> Iterator[str]:
    """What may name the weights of a folder in the version of a policy."""
    if (folder / WEIGHTS).exists():
        yield content_hash(folder)[:_HASH]
        return
    for path in folder.iterdir():
        is_other = path.suffix == ".py" or path.name in (CARD, FIGURE, EVALUATION, TRAINING)
        if path.is_file() and not is_other:
            yield digest_of(path)[:_HASH]


def _training(folder: Path) -> Mapping[str, Any]:
    """What is known of the training: what stands beside the checkpoint, or what LeRobot keeps."""
    if (folder / TRAINING).exists():
        return read(folder / TRAINING)
    known = read(folder / "train_config.json")
    dataset: Any = known.get("dataset")
    is_told = isinstance(dataset, dict)
    found = {
        "policy": read(folder / CONFIG).get("type"),
        "data set": cast("dict[str, Any]", dataset).get("repo_id") if is_told else None,
    }
    found |= {key: known.get(key) for key in ("steps", "batch_size", "seed")}
    return {key: value for key, value in found.items() if value is not None}
