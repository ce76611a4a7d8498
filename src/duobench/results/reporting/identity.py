"""What a run is, as facts in words: what was played, by which policy, on what."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.results.suite import Suite
from duobench.results.suites.catalog import execute_text, latency_text, suite_text

Facts = Mapping[str, str]
"""Values in words by name, in the order in which they are shown."""

_MACHINE = ("platform", "processor", "renderer")
"""What a record's versions say of the machine."""
_TOLD_BY_RUN = ("inference",)
"""What they say that the run says too."""
UNKNOWN = "not known"


def identity(run: Run) -> Facts:
    """What was run, as far as every episode has it in common."""
    suite, policy, config = run.suite, run.metadata, run.config
    height, width = config.image_size
    images = f"{', '.join(config.cameras)}, {width} × {height} pixels" if config.cameras else "none"
    objects = "positions of the objects (privileged)" if config.object_state else None
    inference = [policy.dtype, policy.device, _batching(run)]
    return {
        "Policy": run.policy if policy.name == run.policy else f"{run.policy} ({policy.name})",
        "Its version": policy.version or UNKNOWN,
        **({"Trained on": run.trained_on} if run.trained_on else {}),
        **({"Rig": run.rig[:12]} if run.rig else {}),
        "Suite": _suite(run),
        "Tasks": ", ".join(task.id for task in suite.tasks),
        "Episodes": f"{_indices(suite)}, {suite.episodes} of each task{_shard(run)}",
        **({} if run.is_real else {"Look": suite.look}),
        **({} if run.is_real else {"Shift": str(suite.shift)}),
        "Cameras": images,
        "Other observations": ", ".join(filter(None, ("joints, openings, tool poses", objects))),
        "Action mode": config.action_mode,
        "Chunk": "of varying or unknown length"
        if policy.horizon is None
        else f"{policy.horizon} action{'s' if policy.horizon > 1 else ''}",
        "Executed": f"{execute_text(suite)}, {latency_text(suite)}",
        **({"Overtime": f"up to {suite.overtime:g} horizons"} if suite.overtime > 1 else {}),
        "Instructions": config.instructions,
        "Inference": ", ".join(filter(None, inference)) or UNKNOWN,
        "Time limits": f"{run.limits.act_timeout:g} s an answer, "
        f"{run.limits.episode_timeout:g} s an episode",
    }


def stacks(records: Iterable[EpisodeRecord]) -> list[Facts]:
    """Machines and software that records come from, each combination once."""
    found = dict.fromkeys(tuple(record.versions.items()) for record in records)
    return [_stack(dict(versions)) for versions in found]


def trials(records: Iterable[EpisodeRecord]) -> Facts:
    """What became of trials on real arms; nothing in simulation."""
    judged = [record.judged for record in records if record.judged is not None]
    if not judged:
        return {}
    invalid = Counter(reason for each in judged for reason in each.repeated)
    reasons = "; ".join(f"{reason} ({count})" for reason, count in sorted(invalid.items()))
    return {
        "Judged by": ", ".join(sorted({each.rater for each in judged})),
        "Presses": f"{sum(len(each.presses) for each in judged)}, of which "
        f"{sum(press.stage is None for each in judged for press in each.presses)} take one back",
        "Invalid trials, played again": f"{invalid.total()}: {reasons}" if invalid else "none",
        "Stopped by a reflex": str(sum(each.reflex for each in judged)),
    }


def _stack(versions: Mapping[str, str | None]) -> Facts:
    machine = {name.capitalize(): versions.get(name) or _absent(name) for name in _MACHINE}
    software = [
        f"{name} {version}"
        for name, version in versions.items()
        if version and name not in (*_MACHINE, *_TOLD_BY_RUN)
    ]
    return {**machine, "Software": ", ".join(software)}


def _absent(name: str) -> str:
    return "none: no images for the policy" if name == "renderer" else UNKNOWN


def _indices(suite: Suite) -> str:
    first, last = suite.indices[0], suite.indices[-1]
    return f"number {first}" if first == last else f"numbers {first}–{last}"


def _suite(run: Run) -> str:
    name, split = suite_text(run.suite), run.config.split
    return f"{name}, version {run.suite.version}, layouts of the split {split}"


def _shard(run: Run) -> str:
    return f"; shard {run.shard}, {run.size} episodes" if run.shard else ""


def _batching(run: Run) -> str | None:
    return run.batching and f"{run.batching.mode} batches of {run.batching.size}"
