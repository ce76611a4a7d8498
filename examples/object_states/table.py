"""Train and evaluate the network of this folder on every task of an export, and print the table.

    python table.py exports --out runs --demonstrations 50 --seeds 3 --workers 2

Each network that was played leaves a small file in `results/`; what is there is not done again, so
the same command goes on where it was stopped. `--print` prints the table of what is there, and
`--failures` what did not hold at the end of episodes that failed. With `--images DEMOS` they see
images, rendered from these recordings. With `--self-imitation N` each plays by itself until N
episodes have succeeded, and learns from these as well. With `--corrections EXPORTS` they learn as
well from what a person led in the place of a policy, exported with `--only-corrections`: the
policy's own rows are those that failed.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict
from multiprocessing import active_children
from pathlib import Path
from typing import Any

import network
import numpy as np
from demonstrations import UNTIL, Demonstrations
from learning import Training, locked, once, processor_seconds, write
from own_play import practise

from duobench.core.errors import (
    DataError,
    DuoBenchError,
    EvaluationError,
    OtherRunError,
    check_known,
)
from duobench.core.randomness import SUITE_VERSION
from duobench.evaluation.runners import evaluate
from duobench.results import RunFolder, Suite, find_tasks
from duobench.results.scores import failed_stages, wilson_interval
from duobench.tasks import catalog

RESULTS = Path(__file__).with_name("results")
TOLD = 3
"""Sentences of what did not hold that are told of a stage, the most frequent ones."""
_NUMBERS = re.compile(r"-?\d+(?:\.\d+)?(?: to -?\d+(?:\.\d+)?)?")


def setting(asked: argparse.Namespace) -> str:
    """What is not the recipe itself."""
    until = "" if asked.until == "end" else f"-{asked.until}"
    own = f"-self-{asked.self_imitation}" if asked.self_imitation else ""
    seen = "-images" if asked.images else ""
    led = "-corrections" if asked.corrections else ""
    return f"{asked.demonstrations}{until}{led}{own}{seen}"


def result(asked: argparse.Namespace, task: str, seed: int) -> Path:
    """What one network reached."""
    return asked.results / setting(asked) / f"{task}-{seed}.json"


def job(asked: argparse.Namespace, task: str, seed: int) -> str:
    """Train one network and play it, each unless that is done; what is written is whole.

    Another process that does the same waits for it.
    """
    with locked(asked.out / setting(asked) / task / f"{seed}.job"):
        return _job(asked, task, seed)


def _job(asked: argparse.Namespace, task: str, seed: int) -> str:
    file = result(asked, task, seed)
    if file.exists():
        found = json.loads(file.read_text())
        for what, now in (("suite", SUITE_VERSION), ("episodes", asked.episodes)):
            if found[what] != now:
                raise OtherRunError(
                    f"{file} is of {what} {found[what]}, and this is of {now}: name another "
                    "folder of results."
                )
        return f"{file} is there"
    checkpoint, told = trained(asked, task, seed)
    os.environ["CHECKPOINT"] = str(checkpoint.absolute())
    before = processor_seconds()
    suite = Suite(
        tasks=tuple(find_tasks([task])),
        episodes=asked.episodes,
        gripper=shown(asked, task).gripper,
    )
    policy = "images:Images" if asked.images else "network:Network"
    try:
        results = evaluate(policy, suite, RunFolder(checkpoint.parent / f"run-{seed}"))
    except OtherRunError as error:
        raise OtherRunError(
            f"{error} Delete it, and what was trained is played anew."
        ) from error
    score, played = results.overall, results.tasks[0]
    content = {
        "task": task,
        "suite": SUITE_VERSION,
        "demonstrations": asked.demonstrations,
        "until": asked.until,
        "seed": seed,
        "episodes": score.episodes,
        "successes": score.successes,
        "progress": round(score.mean_final_progress, 4),
        "last_stages": list(played.last_stage_counts),
        "unmet": {
            one.stage: {text: count for count, text in one.unmet}
            for one in failed_stages(played)
        },
        "training": told,
        "evaluation": {"seconds": round(processor_seconds() - before)},
        "checkpoint": _hash(checkpoint),
    }
    write(file, content)
    return f"{file}: {score.successes} of {score.episodes}"


def trained(
    asked: argparse.Namespace, task: str, seed: int
) -> tuple[Path, dict[str, Any]]:
    """One network, trained unless it is there, and what is told of that."""
    folder = asked.out / setting(asked) / task
    checkpoint = folder / f"{seed}.npz"
    told = folder / f"{seed}.json"
    data = shown(asked, task)
    found = once(told, lambda: _trained(asked, task, data, seed, checkpoint))
    recipe = asdict(recipe_of(asked)) | {"seed": seed}
    if found["recipe"] != recipe:
        raise OtherRunError(
            f"{checkpoint} was trained by the recipe {found['recipe']}, and this is {recipe}: name "
            "another --out."
        )
    if found.get("shown", data.hashed()) != data.hashed():
        raise OtherRunError(
            f"{checkpoint} was trained on other demonstrations: name another --out."
        )
    return checkpoint, found


def recipe_of(asked: argparse.Namespace) -> Training:
    """How long a network learns."""
    if not asked.images:
        return network.Training(device=asked.device)
    import train_images  # needs PyTorch to be read

    return train_images.Training(device=asked.device)


def _trained(
    asked: argparse.Namespace,
    task: str,
    data: Demonstrations,
    seed: int,
    checkpoint: Path,
) -> dict[str, Any]:
    """Train one network; what is told of it, and of the one that came first."""
    if asked.self_imitation or asked.images:
        acts, first = trained(first_of(asked), task, seed)
        further = see if asked.images else improve
        told = further(asked, task, data, acts, checkpoint, seed) | {"first": first}
    else:
        told = learn(asked, task, data, checkpoint, seed)
    about = {"shown": data.hashed(), "rows": len(data.state)}
    return about | told | {"checkpoint": _hash(checkpoint)}


def shown(asked: argparse.Namespace, task: str) -> Demonstrations:
    """What people have shown: demonstrations, and corrections behind them.

    Raises:
        DataError: An export is none of these.
    """
    data = Demonstrations.load(asked.export / task, asked.demonstrations, asked.until)
    if not asked.corrections:
        return data
    folder = asked.corrections / task
    led = Demonstrations.load(folder)
    about = json.loads((folder / "meta/duobench.json").read_text())
    if not about["options"]["only_corrections"]:
        raise DataError(
            f"{folder} holds rows of the policy that was corrected too: export with "
            "--only-corrections."
        )
    return data + led


def first_of(asked: argparse.Namespace) -> argparse.Namespace:
    """What comes first: the same on demonstrations and object states alone."""
    return argparse.Namespace(**vars(asked) | {"self_imitation": None, "images": None})


def learn(
    asked: argparse.Namespace,
    task: str,
    data: Demonstrations,
    checkpoint: Path,
    seed: int,
) -> dict[str, Any]:
    """Train one network on object states; what is told of it."""
    return network.train(data, task, checkpoint, seed, recipe_of(asked))


def improve(
    asked: argparse.Namespace,
    task: str,
    data: Demonstrations,
    acts: Path,
    out: Path,
    seed: int,
) -> dict[str, Any]:
    """Train one on what another one achieved as well; what is told of it."""
    os.environ["CHECKPOINT"] = str(acts.absolute())
    place = out.with_name(f"own-{seed}")
    done, own = practise(
        "network:Network", task, place, asked.self_imitation, data.gripper
    )
    both = data + done
    told = learn(asked, task, both, out, seed)
    seconds = told["seconds"] + own["seconds"]
    return told | own | {"seconds": seconds, "rows": len(both.state)}


def see(
    asked: argparse.Namespace,
    task: str,
    data: Demonstrations,
    acts: Path,
    out: Path,
    seed: int,
) -> dict[str, Any]:
    """Train one that sees for another one; what is told of it."""
    import train_images  # needs PyTorch to be read

    before = processor_seconds()
    how = recipe_of(asked)
    pictures = train_images.see(acts, asked.images, task, data, how)
    rendered = round(processor_seconds() - before)
    told = train_images.train(acts, data, pictures, task, out, seed, how)
    return told | {"seconds": rendered + told["seconds"]}


def _hash(checkpoint: Path) -> str:
    return hashlib.sha256(checkpoint.read_bytes()).hexdigest()[:16]


def read(results: Path, name: str) -> dict[str, list[dict[str, Any]]]:
    """What a setting reached in the newest suite that was played: for each task that of every seed.

    A page names that suite, until the networks are trained for a newer one.
    """
    found = [
        json.loads(path.read_text()) for path in sorted((results / name).glob("*.json"))
    ]
    newest = max((one["suite"] for one in found), key=int, default=SUITE_VERSION)
    found = [one for one in found if one["suite"] == newest]
    return {t: [one for one in found if one["task"] == t] for t in catalog.names()}


def table(results: Path, name: str) -> Iterator[str]:
    """Rows in Markdown: every task of a setting, and the mean."""
    yield from _head("task")
    means = []
    for task, seeds in read(results, name).items():
        if seeds:
            means.append(np.mean(_rates(seeds)))
            yield _row(f"`{task}`", seeds)
    if means:
        yield f"| mean of {len(means)} | {100 * np.mean(means):.1f} | | | | |"


def compared(results: Path, task: str, settings: Mapping[str, str]) -> Iterator[str]:
    """Rows in Markdown: one task, learned from what each setting (by its name) is called."""
    yield from _head("learned from")
    for name, what in settings.items():
        seeds = read(results, name)[task]
        if seeds:
            rows = seeds[0]["training"]["rows"]
            yield _row(f"{what} ({rows:,} rows)", seeds)


def _head(first: str) -> Iterator[str]:
    columns = "success (95 %) | by seed | progress | last stages 0, 1, 2, ... | minutes"
    yield f"| {first} | {columns} |"
    yield "| --- | ---: | --- | ---: | --- | --- |"


def _rates(seeds: Sequence[dict[str, Any]]) -> list[float]:
    return [one["successes"] / one["episodes"] for one in seeds]


def _row(first: str, seeds: Sequence[dict[str, Any]]) -> str:
    """A row of some networks; the interval holds the spread of seeds and that of episodes."""
    rates = _rates(seeds)
    low, high = interval(rates, seeds[0]["episodes"])
    counts = np.sum([one["last_stages"] for one in seeds], axis=0)
    stages = ", ".join(map(str, counts))
    progress = np.mean([one["progress"] for one in seeds])
    minutes = ", ".join(_minutes(one["training"]) for one in seeds)
    return (
        f"| {first} | {100 * np.mean(rates):.0f} ({100 * low:.0f} to {100 * high:.0f}) "
        f"| {', '.join(f'{100 * rate:.0f}' for rate in rates)} | {progress:.2f} | {stages} "
        f"| {minutes} |"
    )


def _minutes(training: dict[str, Any]) -> str:
    """Processor minutes of a training, behind those of the network that came first."""
    first = f"{_minutes(training['first'])} + " if "first" in training else ""
    return f"{first}{training['seconds'] / 60:.0f}"


def failures(results: Path, name: str) -> Iterator[str]:
    """Rows in Markdown: how many failed episodes a stage ended, and what of the next did not hold.

    Counted over all seeds, from what the records say was unmet; numbers in it are left out.
    """
    yield "| task | failed | last stage | what did not hold of the next one |"
    yield "| --- | ---: | --- | --- |"
    for task, seeds in read(results, name).items():
        failed = sum(one["episodes"] - one["successes"] for one in seeds)
        stages = sorted({stage for one in seeds for stage in one["unmet"]}, key=int)
        for nth, stage in enumerate(stages):
            unmet: Counter[str] = Counter()
            for one in seeds:
                for text, count in one["unmet"].get(stage, {}).items():
                    unmet[_NUMBERS.sub("…", text)] += count
            count = sum(one["last_stages"][int(stage)] for one in seeds)
            begin = f"`{task}` | {failed}" if nth == 0 else " | "
            told = "; ".join(f"{text} ({n})" for text, n in unmet.most_common(TOLD))
            yield f"| {begin} | {stage} ({count}) | {told} |"


def interval(rates: Sequence[float], episodes: int) -> tuple[float, float]:
    """Wilson's interval of 95 % for the mean rate of networks that play the same episodes.

    Its number of episodes is that which would spread as much as the episodes and the seeds of
    training do together.
    """
    mean = float(np.mean(rates))
    of_seeds = np.var(rates, ddof=1) / len(rates) if len(rates) > 1 else 0.0
    of_episodes = mean * (1 - mean) / episodes
    if of_episodes:
        episodes = round(episodes * of_episodes / (of_episodes + of_seeds))
    return wilson_interval(round(mean * episodes), episodes)


def run(asked: argparse.Namespace) -> None:
    """Do what is left, a seed of every task after the other.

    Raises:
        DuoBenchError: An export or a result is none that this can go on with.
    """
    for task in asked.tasks:
        check_known("task", task, catalog.names())
        if not all(result(asked, task, seed).exists() for seed in range(asked.seeds)):
            shown(asked, task)
    jobs = [(seed, task) for seed in range(asked.seeds) for task in asked.tasks]
    others = active_children()
    with ProcessPoolExecutor(asked.workers) as pool:
        left = [pool.submit(job, asked, task, seed) for seed, task in jobs]
        try:
            for done, one in enumerate(as_completed(left), 1):
                print(f"{done} of {len(jobs)}: {one.result()}", flush=True)
        except BaseException as error:  # Ctrl-C too: nothing goes on for minutes
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in active_children():
                if worker not in others:
                    worker.terminate()
            if isinstance(error, BrokenProcessPool):
                raise EvaluationError(
                    "A process of this table was killed, perhaps because memory ran out; the same "
                    "command goes on where it was, with fewer workers too."
                ) from error
            raise


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "export", type=Path, nargs="?", help="folder with a data set for each task"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("runs"), help="networks and records"
    )
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--tasks", nargs="+", default=catalog.names())
    parser.add_argument("--demonstrations", type=int, default=50)
    parser.add_argument(
        "--until", choices=UNTIL, default="end", help="where they are cut"
    )
    parser.add_argument(
        "--images", type=Path, metavar="DEMOS", help="recordings to render"
    )
    parser.add_argument(
        "--self-imitation", type=int, metavar="N", help="own successes to learn from"
    )
    parser.add_argument(
        "--corrections", type=Path, metavar="EXPORTS", help="to learn from as well"
    )
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--device", default="cpu", help="what PyTorch trains on")
    parser.add_argument("--print", action="store_true", help="only print what is there")
    parser.add_argument(
        "--failures", action="store_true", help="print what failed instead"
    )
    given = parser.parse_args()
    if given.images and (given.self_imitation or given.corrections):
        parser.error("own successes and corrections are learned from without images")
    if not (given.print or given.failures):
        if given.export is None:
            parser.error("the folder of an export is missing")
        try:
            run(given)
        except DuoBenchError as error:
            parser.exit(1, f"error: {error}\n")
        except KeyboardInterrupt:
            parser.exit(130, "Stopped; the same command goes on where it was.\n")
    told = failures if given.failures else table
    print("\n".join(told(given.results, setting(given))))
    if not any(read(given.results, setting(given)).values()):
        print(f"{given.results / setting(given)} holds no result.", file=sys.stderr)
