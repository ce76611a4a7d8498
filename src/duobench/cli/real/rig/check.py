"""`duobench real rig check`: what a rig's file lets arms, grippers and cameras do."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import tyro

from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import say
from duobench.cli.shared.rigs import known_rig
from duobench.core.types import ARM_JOINTS, Side
from duobench.real.addresses import share_subnet
from duobench.real.catalog import load_driver
from duobench.real.guard import Guard
from duobench.real.rig import (
    ArmConfig,
    CameraConfig,
    GripperConfig,
    Rig,
)
from duobench.world.robot.cameras import HEAD
from duobench.world.robot.gripper import Gripper
from duobench.world.robot.joints import VELOCITY_LIMITS


def run(file: tyro.conf.Positional[str]) -> None:
    """Say what will hold on a rig, or what is wrong with its file, which ends with exit code 1.

    Args:
        file: The rig's file, rig.json, or rehearsal.
    """
    known = known_rig(file)
    known.check_computed()
    robot = known.robot
    problem = Guard(robot, known.workspace, known.obstacles).problem(robot.home)
    if problem:
        raise AdvisedError(
            f"The arms cannot be at home beside what {file} says is in the way: {problem} Put its "
            "obstacles where they are, or leave them out."
        )
    for line in described(known):
        say(line)


def described(rig: Rig) -> Iterable[str]:
    """Limits and devices of a rig, line by line."""
    yield f"Rig {rig.name}, hash {rig.hash}"
    yield f"Gripper {rig.robot.gripper.name}, mount {rig.mount}"
    for side, arm in rig.arms.items():
        yield from _arm(side, arm)
    addresses = [arm.address for arm in rig.arms.values()]
    if share_subnet(*addresses):
        yield (
            f"Note: both arms are in one subnet, {' and '.join(addresses)}; give each control box "
            "a network port and a subnet of its own."
        )
    for side, gripper in rig.grippers.items():
        yield _gripper(side, gripper, rig.robot.gripper)
    for name, camera in rig.cameras.items():
        yield _camera(name, camera)
    if not rig.cameras:
        yield "No cameras."
    elif HEAD not in rig.cameras:
        yield "Note: no head camera; placing has numbers and footprints alone, and no film."
    if rig.workspace is None:
        yield "Workspace: none; tools go wherever the arms reach."
    else:
        box = zip("xyz", rig.workspace.low, rig.workspace.high, strict=True)
        inside = ", ".join(f"{axis} {low:g} to {high:g}" for axis, low, high in box)
        yield f"Workspace of both tools: {inside} m in the table frame"
    for name, each in rig.obstacles.items():
        size = " x ".join(f"{length:g}" for length in each.size)
        at = ", ".join(f"{value:g}" for value in each.centre)
        yield f"Obstacle {name}: {size} m around {at}, turned by {np.degrees(each.yaw):.0f} deg"


def _arm(side: Side, arm: ArmConfig) -> Iterable[str]:
    limits = np.array(VELOCITY_LIMITS)
    speeds, home = arm.speed_fraction * limits, arm.home_fraction * limits
    yield f"{side.capitalize()} arm: {_device(arm.driver, arm.address)}"
    rows: dict[str, Iterable[float]] = {
        "joint": range(1, ARM_JOINTS + 1),
        "at most rad/s": speeds,
        "at most deg/s": np.degrees(speeds).round(),
        "way home, deg/s": np.degrees(np.minimum(speeds, home)).round(),
        "stops at N·m": arm.torque_threshold,
        "stiffness, N·m/rad": arm.stiffness,
        "damping, N·m·s/rad": arm.damping,
    }
    for name, values in rows.items():
        yield f"  {name:18}" + "".join(f"{value:8.4g}" for value in values)
    yield (
        f"  acceleration at most {arm.acceleration:g} rad/s², tool at most {arm.tool_speed:g} m/s; "
        f"stops at {arm.force_threshold:g} N and {arm.moment_threshold:g} N·m at the tool"
    )


def _gripper(side: Side, gripper: GripperConfig, kind: Gripper) -> str:
    ends = ""
    if hasattr(load_driver("grippers", kind.driver), "measure_ends"):
        ends = f"; open at {gripper.open_count}, closed at {gripper.closed_count}"
    return (
        f"{side.capitalize()} gripper: {_device(gripper.driver, gripper.port)}, "
        f"{gripper.newtons(kind):.0f} N, {gripper.mm_per_s(kind):.0f} mm/s{ends}"
    )


def _camera(name: str, camera: CameraConfig) -> str:
    height, width = camera.size
    lens = camera.calibration
    calibrated = (
        "not calibrated" if lens is None else f"calibrated {lens.date}".rstrip()
    )
    depth = ", with depth" if camera.depth else ""
    return (
        f"Camera {name}: {_device(camera.driver, camera.device)}, {width} x {height} pixels, "
        f"{camera.fps} Hz{depth}; {calibrated}"
    )


def _device(driver: str, place: str) -> str:
    return f"{driver} at {place}" if place else str(driver)
