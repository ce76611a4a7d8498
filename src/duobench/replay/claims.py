"""What a record claims about its episode, and where a replay of its targets says otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from duobench.envs import action_modes
from duobench.errors import escaped
from duobench.results.records import EpisodeRecord, StateHashes

TOLERANCE = 1e-6
"""Difference of a pose that another processor may make, in metres or in parts of a quaternion."""
LONGEST_CLAIM = 120
"""Characters of a claim that are shown."""
_OUTCOME = (
    *("seed", "horizon", "max_stage", "steps", "stage_changes", "final_stage", "success"),
    *("success_at_end", "terminated", "truncated"),
)


def disagreements(record: EpisodeRecord, replay: EpisodeRecord) -> list[str]:
    """What a record claims and its replay does not show, though it would on any processor.

    The replay has the same error. What both say is one phrase each.
    """
    claimed, shown = _outcome(record), _outcome(replay)
    found = _different(claimed, shown)
    poses, starts = _poses(record), _poses(replay)
    found += [
        _phrase(name, pose, starts.get(name))
        for name, pose in poses.items()
        if name not in starts or not np.allclose(pose, starts[name], rtol=0, atol=TOLERANCE)
    ]
    found += [_phrase(name, None, starts[name]) for name in starts.keys() - poses.keys()]
    if record.error is None and record.steps == replay.steps and not _is_over(replay):
        found.append(f"the episode is not over after {record.steps} steps")
    return found


def differing_bits(record: EpisodeRecord, replay: EpisodeRecord) -> list[str]:
    """What in a record is not equal to the bit to its replay; on other processors it need not be.

    See `disagreements`. Words on what the next stage lacks are none where the last step failed.
    """
    if record.unmet is None:
        replay = replace(replay, unmet=None)
    return _different(_bits(record), _bits(replay))


def _is_over(record: EpisodeRecord) -> bool:
    return record.terminated or record.truncated


def _outcome(record: EpisodeRecord) -> dict[str, Any]:
    claims = {name: getattr(record, name) for name in _OUTCOME}
    claims["instruction"] = record.instruction
    variants = record.layout.get("variants", {})
    return claims | {f"variant {name}": value for name, value in variants.items()}


def _poses(record: EpisodeRecord) -> dict[str, Any]:
    return {f"start of {name}": pose for name, pose in record.layout.get("poses", {}).items()}


def _bits(record: EpisodeRecord) -> dict[str, Any]:
    claims = {
        **_poses(record),
        **_hashes("start", record.start),
        **_hashes("end", record.end),
        "unmet": record.unmet,
    }
    # What relative Cartesian actions add up to is part of it, and not of what was sent.
    if record.config.action_mode != action_modes.CARTESIAN_RELATIVE.name:
        claims["state_hash"] = record.state_hash
    return claims


def _hashes(moment: str, hashes: StateHashes | None) -> dict[str, Any]:
    return {
        f"physics at the {moment}": hashes and hashes.physics,
        f"stages at the {moment}": hashes and hashes.stages,
    }


def _different(claimed: Mapping[str, Any], shown: Mapping[str, Any]) -> list[str]:
    return [
        _phrase(name, claimed.get(name), shown.get(name))
        for name in {**claimed, **shown}
        if claimed.get(name) != shown.get(name)
    ]


def _phrase(name: str, claimed: object, shown: object) -> str:
    return f"{name} is {_short(claimed)}, the replay gives {_short(shown)}"


def _short(claim: object) -> str:
    text = escaped(claim if isinstance(claim, str) else str(claim)).replace("\n", " ")
    return text if len(text) <= LONGEST_CLAIM else f"{text[:LONGEST_CLAIM]}…"
