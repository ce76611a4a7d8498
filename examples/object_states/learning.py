"""How the networks of this folder learn: for as long as they play better.

The average of the weights of late plays layouts of `train` every so many steps, and what has
played best is kept (see `own_play.Trial`): the error on demonstrations that are held out does not
tell success. What was stopped goes on at its last look, to the same bits.
"""

from __future__ import annotations

import copy
import fcntl
import json
import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from duobench.core.errors import DataError

LATE = 10
"""One part in so many of all steps so far is averaged over."""
PRINT_EVERY = 500
"""Steps between two lines that tell how it goes."""


@dataclass(frozen=True)
class Training:
    """How long a network learns."""

    batch: int = 256
    rate: float = 1e-3
    decay: float = 0.1
    """Of weights; AdamW's, which is multiplied by the rate."""
    warm_up: int = 100
    """Steps."""
    every: int = 2500
    """Steps between two looks at how it plays."""
    most: int = 30_000
    """Steps at most."""
    patience: int = 5_000
    """Steps in which no look sees more successes, after which it is over."""
    episodes: int = 40
    """Episodes of a look. Success in all of them, twice in a row, ends it too."""
    device: str = "cpu"
    """What PyTorch trains on; networks play on the processor."""


Look = Callable[[Any, Path], tuple[int, float]]
"""Writes a network to a file and plays it: successes, and mean final progress."""


def learn(
    net: Any,
    error: Callable[[], Any],
    how: Training,
    look: Look,
    out: Path,
    seed: int,
    source: str,
) -> dict[str, Any]:
    """Train a network with Adam, and leave the one that played best in a file.

    Beside it stays what a training goes on from, until `forget` deletes that.

    Args:
        net: The network, on its device.
        error: Draws rows with PyTorch's generator of the processor; their error.
        how: How long.
        look: Writes and plays a network.
        out: The file.
        seed: Of the numbers that `error` draws.
        source: Hash of what is learned from.

    Returns:
        What is told of it: recipe, source, processor seconds, steps, those of the network that is
        kept, and what each look saw.

    Raises:
        DataError: What was stopped learned in another way, or from something else.
    """
    import torch

    out.parent.mkdir(parents=True, exist_ok=True)
    net.train()
    average = copy.deepcopy(net)
    adam = torch.optim.AdamW(
        net.parameters(), lr=how.rate, weight_decay=how.decay, fused=True
    )
    looks: list[tuple[int, float]] = []
    before, spent = processor_seconds(), 0.0
    unfinished, candidate = _unfinished(out), out.with_suffix(".last.npz")
    recipe = asdict(how) | {"seed": seed}
    torch.manual_seed(seed)
    if unfinished.exists():
        left = torch.load(unfinished, weights_only=False, map_location=how.device)
        if (left["recipe"], left["source"]) != (recipe, source):
            raise DataError(
                f"{unfinished} is left of a training of another recipe, or from something else: "
                "delete it."
            )
        if not out.exists():
            raise DataError(
                f"{out} is gone, which {unfinished} goes on from: delete it."
            )
        net.load_state_dict(left["net"])
        average.load_state_dict(left["average"])
        adam.load_state_dict(left["adam"])
        torch.set_rng_state(left["drawn"].cpu())
        looks, spent = left["looks"], left["spent"]
    while not _is_over(looks, how):
        for step in range(len(looks) * how.every, (len(looks) + 1) * how.every):
            for group in adam.param_groups:
                group["lr"] = how.rate * min(1.0, (step + 1) / how.warm_up)
            adam.zero_grad()
            lost = error()
            lost.backward()
            adam.step()
            if step % PRINT_EVERY == 0:
                print(f"step {step}: error {float(lost.detach()):.3f}", flush=True)
            with torch.no_grad():
                for late, now in zip(
                    average.parameters(), net.parameters(), strict=True
                ):
                    late.lerp_(now, LATE / (LATE + step))
        looks.append(look(average.eval(), candidate))
        if looks[-1] == max(looks):
            candidate.replace(out)
        steps = len(looks) * how.every
        print(f"step {steps}: {looks[-1][0]} of {how.episodes} succeed", flush=True)
        left = {"recipe": recipe, "source": source, "looks": looks}
        left["drawn"] = torch.get_rng_state()
        left["spent"] = spent + processor_seconds() - before
        left |= {part: one.state_dict() for part, one in _parts(net, average, adam)}
        torch.save(left, candidate)
        candidate.replace(unfinished)
    return {
        "recipe": recipe,
        "source": source,
        "seconds": round(spent + processor_seconds() - before),
        "steps": len(looks) * how.every,
        "kept": (_best(looks) + 1) * how.every,
        "looks": [[successes, round(progress, 3)] for successes, progress in looks],
    }


def forget(out: Path) -> None:
    """Delete what a training of this file would go on from, once all is told of it."""
    _unfinished(out).unlink(missing_ok=True)


def _unfinished(out: Path) -> Path:
    return out.with_suffix(".part")


def _parts(net: Any, average: Any, adam: Any) -> list[tuple[str, Any]]:
    return [("net", net), ("average", average), ("adam", adam)]


def _best(looks: list[tuple[int, float]]) -> int:
    """The last of the best looks."""
    return max(range(len(looks)), key=lambda nth: (looks[nth], nth))


def _is_over(looks: list[tuple[int, float]], how: Training) -> bool:
    """Whether a network learns no longer."""
    if not looks:
        return False
    successes = [number for number, _ in looks]
    late = len(looks) - 1 - successes.index(max(successes))
    return (
        successes[-2:] == [how.episodes] * 2
        or len(looks) * how.every >= how.most
        or late * how.every >= how.patience
    )


def once(file: Path, do: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """What is told of something that was done, in a file; it is done unless the file is there.

    With the processor seconds that it took, where it does not tell them itself. Another process
    that does the same waits for it.
    """
    with locked(file.with_suffix(".lock")):
        if not file.exists():
            before = processor_seconds()
            told = do()
            write(file, {"seconds": round(processor_seconds() - before)} | told)
        forget(file)
    return json.loads(file.read_text())


@contextmanager
def locked(file: Path) -> Iterator[None]:
    """A time in which no other process holds this file."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def processor_seconds() -> float:
    """What this process and those that it waited for have used."""
    used = (
        resource.getrusage(who)
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return sum(one.ru_utime + one.ru_stime for one in used)


def write(path: Path, content: dict[str, Any]) -> None:
    """Write a file of JSON, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(".unfinished")
    unfinished.write_text(json.dumps(content, indent=1) + "\n")
    unfinished.replace(path)
