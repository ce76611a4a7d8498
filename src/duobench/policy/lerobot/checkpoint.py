"""The files of a checkpoint: where they are, whether they are all there, and their hash."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from duobench.errors import PolicyError
from duobench.lerobot_keys import FEATURE_NAMES, LAST, SUITE
from duobench.randomness import SUITE_VERSION

CONFIG, WEIGHTS = "config.json", "model.safetensors"
PROCESSORS = ("policy_preprocessor.json", "policy_postprocessor.json")
ADAPTER = "adapter_config.json"
"""What low-rank adapters are saved with, in place of the weights."""
_NOT_THE_POLICY = ("train_config.json",)
"""Files that change nothing about what the policy does."""


def find(checkpoint: str) -> Path:
    """The folder of a checkpoint; one on the Hub is downloaded.

    Args:
        checkpoint: A folder, or an id `user/name` on the Hub.

    Raises:
        PolicyError: It is neither, cannot be downloaded, or files are missing.
    """
    path = Path(checkpoint).expanduser()
    if path.is_dir():
        return _checked(path, checkpoint)
    is_id = checkpoint.count("/") == 1 and not checkpoint.startswith((".", "/", "~"))
    if not is_id:
        raise PolicyError(
            f"There is no folder {checkpoint}, and it is no id on the Hub, which is user/name."
        )
    from huggingface_hub import snapshot_download  # pyright: ignore[reportMissingImports]

    try:
        folder = snapshot_download(checkpoint, allow_patterns=["*.json", "*.safetensors"])
    except (OSError, ValueError) as error:  # the errors of its connections are OSErrors
        raise PolicyError(
            f"There is no folder {checkpoint}, and no checkpoint of that id was downloaded: {error}"
        ) from error
    return _checked(Path(folder), checkpoint)


def content_hash(folder: Path) -> str:
    """SHA-256 over the names and contents of configuration, weights and processors."""
    digest = hashlib.sha256()
    for path in sorted(folder.iterdir(), key=lambda path: path.name):
        if path.suffix in {".json", ".safetensors"} and path.name not in _NOT_THE_POLICY:
            with path.open("rb") as file:
                content = hashlib.file_digest(file, "sha256").hexdigest()
            digest.update(f"{path.name} {content}\n".encode())
    return digest.hexdigest()


def read(path: Path) -> Mapping[str, Any]:
    """A JSON object from a file; an empty one where there is none.

    Raises:
        PolicyError: It cannot be read.
    """
    try:
        content = json.loads(path.read_bytes())
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise PolicyError(f"Cannot read {path}: {error}") from error
    return content if isinstance(content, Mapping) else {}


def _checked(folder: Path, checkpoint: str) -> Path:
    if (folder / ADAPTER).exists():
        raise PolicyError(
            f"{checkpoint} holds adapters alone ({ADAPTER}); merge them into the weights of the "
            "base and save the whole policy."
        )
    missing = [name for name in (CONFIG, WEIGHTS) if not (folder / name).exists()]
    if missing:
        last = folder / LAST
        hint = f" Did you mean {Path(checkpoint) / LAST}?" if last.is_dir() else ""
        raise PolicyError(f"{checkpoint} is no LeRobot policy: no {', '.join(missing)}.{hint}")
    suite = read(folder / FEATURE_NAMES).get(SUITE)
    if suite not in (None, SUITE_VERSION):
        raise PolicyError(
            f"{checkpoint} was trained on suite {suite}; this version plays suite {SUITE_VERSION}, "
            "whose episodes and scores are others. Train it again."
        )
    missing = [name for name in PROCESSORS if not (folder / name).exists()]
    if missing:
        raise PolicyError(
            f"{checkpoint} has no {', '.join(missing)}: it was saved by an older LeRobot. Convert "
            "it with LeRobot's module lerobot.processor.migrate_policy_normalization."
        )
    return folder
