from dataclasses import replace

from duobench.envs.config import EnvConfig
from duobench.policy import Batching, PolicyMetadata
from duobench.results.reporting.identity import identity, stacks
from tests.results.samples import SORT, TURN, sample_record, sample_run


def test_a_run_is_told_by_everything_that_was_chosen() -> None:
    run = sample_run(
        tasks=(SORT, TURN),
        first_episode=3,
        look="dark",
        overtime=1.5,
        metadata=PolicyMetadata(
            name="net", version="7", horizon=30, object_state=True, dtype="float16", device="cuda"
        ),
        config=EnvConfig(
            cameras=("head",), image_size=(96, 128), object_state=True, action_mode="cartesian"
        ),
        batching=Batching(mode="dynamic", size=4),
    )
    facts = identity(run)
    assert facts["Policy"] == "mine (net)"
    assert facts["Its version"] == "7"
    assert facts["Tasks"] == "sort, turn"
    assert facts["Episodes"] == "numbers 3–6, 4 of each task"
    assert facts["Look"] == "dark"
    assert facts["Cameras"] == "head, 128 × 96 pixels"
    assert "privileged" in facts["Other observations"]
    assert facts["Action mode"] == "cartesian"
    assert facts["Overtime"] == "up to 1.5 horizons"
    assert facts["Chunk"] == "30 actions"
    assert facts["Inference"] == "float16, cuda, dynamic batches of 4"


def test_what_is_not_known_is_said() -> None:
    facts = identity(sample_run(metadata=PolicyMetadata(name="mine")))
    assert facts["Its version"] == facts["Inference"] == "not known"
    assert facts["Cameras"] == "none"
    assert "Overtime" not in facts
    assert "unknown" in facts["Chunk"]


def test_machines_and_software_are_told_once_each() -> None:
    here = {"platform": "Linux", "processor": "Best 9", "renderer": None, "numpy": "2", "mink": ""}
    record = sample_record(TURN, 0, (3,), versions=here)
    other = replace(record, episode=2, versions={**here, "renderer": "egl"})
    assert stacks([record, replace(record, episode=1), other]) == [
        {
            "Platform": "Linux",
            "Processor": "Best 9",
            "Renderer": "none: no images for the policy",
            "Software": "numpy 2",
        },
        {"Platform": "Linux", "Processor": "Best 9", "Renderer": "egl", "Software": "numpy 2"},
    ]
