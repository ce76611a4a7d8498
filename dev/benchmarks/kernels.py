"""Play the same episodes as processors of other types would, and compare them bit for bit.

NumPy's BLAS picks its kernel by the type of the processor, and so do some of NumPy's own loops. The
environment variables that choose both let one machine stand for others; each variant is a process
of its own that sets them, whatever the surrounding environment says. The first variant plays the
experts and keeps their joint targets, all others replay those.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any

import mujoco
import numpy as np

numpy_core = import_module("numpy._core._multiarray_umath")  # which has no types
BLAS, LOOPS = "OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES"
"""Variables that choose OpenBLAS's kernel, and that switch NumPy's loops off."""
WIDE_LOOPS = " ".join(
    name for name in numpy_core.__cpu_dispatch__ if name == "X86_V4" or name.startswith("AVX512")
)
"""NumPy's loops for AVX-512, as this version of NumPy calls them."""
VARIANTS: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "haswell": {BLAS: "Haswell"},
        "haswell, narrow loops": {BLAS: "Haswell", LOOPS: WIDE_LOOPS},
        "skylakex": {BLAS: "SkylakeX"},
        "sandybridge, narrow loops": {BLAS: "Sandybridge", LOOPS: WIDE_LOOPS},
        "prescott, narrow loops": {BLAS: "Prescott", LOOPS: WIDE_LOOPS},
    }
)
"""What each variant sets: processors with AVX2, with AVX-512, with AVX, and with SSE3 alone."""
QUICK = ("haswell, narrow loops", "haswell", "skylakex")
"""The variants of the test."""
NEEDS_AVX512 = ("skylakex",)

Found = dict[str, Any]


def has_avx512() -> bool:
    """Whether this processor can play the variants with AVX-512."""
    return bool(numpy_core.__cpu_features__.get("AVX512F", False))


def playable(names: Iterable[str]) -> list[str]:
    """The variants among these that this processor can play."""
    return [name for name in names if name not in NEEDS_AVX512 or has_avx512()]


def play(variant: str, job: Mapping[str, Any]) -> Found:
    """What a process of a variant finds; see `report`."""
    kept = {name: value for name, value in os.environ.items() if name not in (BLAS, LOOPS)}
    result = subprocess.run(
        [sys.executable, "-m", "dev.benchmarks.kernels"],
        input=json.dumps(dict(job)),
        env={**kept, **VARIANTS[variant]},
        check=False,
        capture_output=True,
        text=True,
    )
    if result.returncode != 0:
        raise RuntimeError(f"The variant {variant!r} failed.\n{result.stderr}")
    return json.loads(result.stdout)


def compare(
    variants: Sequence[str], tasks: Sequence[str], seeds: Sequence[int], *, experts: bool = False
) -> dict[str, Found]:
    """What each variant finds, by its name.

    Args:
        variants: Names of variants; the first one's experts make the joint targets.
        tasks: Ids of tasks.
        seeds: Seeds of each task.
        experts: Whether the experts play in every variant, not only in the first.
    """
    found: dict[str, Found] = {}
    with tempfile.TemporaryDirectory() as folder:
        targets = str(Path(folder) / "targets.npz")
        for number, variant in enumerate(variants):
            found[variant] = play(
                variant,
                {
                    "tasks": list(tasks),
                    "seeds": list(seeds),
                    "targets": targets,
                    "first": number == 0,
                    "experts": experts,
                },
            )
    return found


# --- in the process of a variant ------------------------------------------------------------------


def report(job: Mapping[str, Any]) -> Found:
    """What this process makes of a job: digests of models, resets, replays and expert episodes.

    Each is a dictionary; the keys of models are tasks and arrays, all others "task seed".
    """
    import duobench
    from duobench.envs.sim_env import sim_of

    path = Path(job["targets"])
    kept = {} if job["first"] else dict(np.load(path))
    found: Found = {"probe": probe(), "models": {}, "resets": {}, "replays": {}, "experts": {}}
    for task in job["tasks"]:
        env = duobench.make(task, cameras=False)
        for seed in job["seeds"]:
            key = f"{task} {seed}"
            if job["first"]:
                kept[key] = _targets(env, task, seed)
            if job["first"] or job["experts"]:
                targets = kept[key] if job["first"] else _targets(env, task, seed)
                found["experts"][key] = _digest(targets.tobytes())
            found["resets"][key], found["replays"][key] = _replay(env, seed, kept[key])
        found["models"][task] = model_digests(sim_of(env).simulation.model)
        env.close()
    if job["first"]:
        np.savez(path, **kept)
    return found


def model_digests(model: mujoco.MjModel) -> dict[str, str]:
    """A digest of every array of a compiled model, by its name."""
    arrays = {name: getattr(model, name) for name in dir(model) if not name.startswith("_")}
    return {
        name: _digest(array.tobytes())
        for name, array in arrays.items()
        if isinstance(array, np.ndarray)
    }


def probe() -> dict[str, str]:
    """Digests of results that do depend on the kernels: they show that the switches work."""
    numbers = np.random.default_rng(0).uniform(-1.0, 1.0, size=(400, 3, 3))
    lengths = np.array([np.linalg.norm(vector) for vector in numbers.reshape(-1, 3)])
    return {
        "blas": _digest(lengths.tobytes()),
        "loops": _digest(np.arccos(numbers).tobytes() + np.exp(numbers).tobytes()),
    }


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


def _targets(env: Any, task: str, seed: int) -> np.ndarray:
    """The actions (n, 16) of the expert's episode."""
    from duobench.core.randomness import policy_seed
    from duobench.evaluation.policies import ExpertPolicy

    observation, info = env.reset(seed=seed)
    expert = ExpertPolicy(env)
    expert.reset(info["instruction"], policy_seed(task, seed))
    actions, over = [], False
    while not over:
        actions.append(np.asarray(expert.act(observation), dtype=np.float32)[0])
        observation, _, terminated, truncated, _ = env.step(actions[-1])
        over = terminated or truncated
    return np.array(actions)


def _replay(env: Any, seed: int, targets: np.ndarray) -> tuple[str, str]:
    """Digests of the state after a reset, and of all that followed.

    That is states, memories of stages, observations, rewards and lowest points.
    """
    from duobench.envs.sim_env import sim_of

    simulation = sim_of(env).simulation
    observation, _ = env.reset(seed=seed)
    reset = env.get_wrapper_attr("state_hash")()
    digest = hashlib.sha256()
    for action in targets:
        observation, reward, *_ = env.step(action)
        for name in sorted(observation):
            digest.update(np.asarray(observation[name]).tobytes())
        lowest = [simulation.min_height(name) for name in simulation.props]
        digest.update(np.array([reward, *lowest]).tobytes())
        digest.update(env.get_wrapper_attr("state_hash")().encode())
    return reset[:16], digest.hexdigest()[:16]


if __name__ == "__main__":
    print(json.dumps(report(json.loads(sys.stdin.read()))))
