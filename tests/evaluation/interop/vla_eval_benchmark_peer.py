"""Run by the environment of vla-eval, with DuoBench: our benchmark as its programs see it.

Prints one JSON object.
"""

import json
import sys
from typing import Any

import anyio
import numpy as np
from vla_eval.orchestrator import _accepted_init_params
from vla_eval.registry import resolve_import_string
from vla_eval.specs import check_specs

NAME = "duobench.evaluation.interop.vla_eval:DuoBench"
STEPS = 3


async def main() -> dict[str, Any]:
    kind = resolve_import_string(NAME)
    benchmark = kind(
        task_ids=["bin_sort"], seed=1, max_steps=STEPS, camera_resolution=[24, 32], frequency=30
    )
    (task,) = benchmark.get_tasks()
    probe = benchmark.get_hold_action(None)["actions"]
    await benchmark.start_episode({**task, "episode_idx": 1})
    begun = await benchmark.get_result()
    shown = await benchmark.get_observation()
    hold = benchmark.get_hold_action(None)
    await benchmark.apply_action(hold)
    await benchmark.apply_action({"actions": np.tile(hold["actions"], (9, 1))})
    is_done, result = await benchmark.is_done(), await benchmark.get_result()
    errors = []
    for action in ({"action": hold["actions"]}, {"actions": np.zeros(14)}):
        try:
            await benchmark.apply_action(action)
        except Exception as error:  # noqa: BLE001 - the other process judges
            errors.append(str(error))
    specs = benchmark.get_action_spec(), benchmark.get_observation_spec()
    benchmark.cleanup()
    return {
        "parameters": sorted(_accepted_init_params(kind)),
        "task": task,
        "metadata": benchmark.get_metadata(),
        "metrics": benchmark.get_metric_keys(),
        "sizes": {name: spec.dims for name, spec in specs[0].items()},
        "mismatches": check_specs(specs[0], specs[0], specs[1], specs[1]),
        "probe": probe.shape,
        "begun": begun,
        "state": shown["states"].tolist(),
        "images": {name: image.shape for name, image in shown["images"].items()},
        "is_done": is_done,
        "result": result,
        "errors": errors,
        "gpu": kind.configure_render("gpu"),
        "cpu": kind.configure_render("cpu"),
    }


json.dump(anyio.run(main), sys.stdout)
