"""A third gripper: two boxes on a slide, with a tool offset and a width of its own."""

from mujoco import mjtEq, mjtJoint, mjtObj, mjtTrn

from duobench.core.spatial import SE3
from duobench.world.robot.fr3_links import Link
from duobench.world.robot.gripper import Gripper
from duobench.world.scene.meshes import add_link
from duobench.world.scene.naming import drive_names, gripper_name
from duobench.world.scene.surfaces import DISTAL, add_box, collide_as_metal

PINCERS = Gripper(
    name="Pincers",
    model="tests.world.robot.third_gripper:add_pincers",
    fingers=("left", "right"),
    pad="box",
    drive="slide",
    drive_closed=0.06,
    ctrl_closed=1.0,
    stroke=0.12,
    yaw=0.5,
    flange_from_base=SE3(),
    tool_offset=0.21,
    tips=0.01,
    camera=(0.06, 0.0, 0.12),
    bracket=(0.05, 0.0, 0.08),
    reach=0.3,
    mass=0.6,
    speeds=(0.01, 0.2),
    forces=(5.0, 60.0),
    force=40.0,
    driver="duobench.real.drivers.robotiq:RobotiqGripper",
    libraries=(),
)


def add_pincers(spec, gripper, side, body, flange):
    prefix, group, grey = gripper_name(side), DISTAL[side], (0.4, 0.4, 0.4, 1.0)
    still = {"centre": (0, 0, 0.1), "axes_wxyz": (1, 0, 0, 0), "inertia": (1e-4,) * 3}
    base = add_link(body, f"{prefix}/base", Link(mass=0.5, **still))
    base.pos, base.quat = flange.translation, flange.wxyz
    collide_as_metal(add_box(base, SE3.at(z=0.07), (0.06, 0.16, 0.14), grey), group)
    tendon = spec.add_tendon(name=prefix, damping=[gripper.force / 0.2, 0, 0])
    for name, sign in zip(gripper.fingers, (-1, 1), strict=True):
        middle = (0, sign * 0.065, 0.18)
        finger = add_link(
            base, f"{prefix}/{name}_box", Link(mass=0.05, **still | {"centre": middle})
        )
        slide = finger.add_joint(name=f"{prefix}/{name}_slide", axis=(0, -sign, 0), armature=0.1)
        slide.type, slide.limited, slide.range = mjtJoint.mjJNT_SLIDE, True, (0, 0.061)
        box = add_box(finger, SE3.at(*middle), (0.02, 0.01, 0.08), grey)
        collide_as_metal(box, group)
        box.friction = (0.8, 0.005, 0.0001)
        tendon.wrap_joint(slide.name, 1.0)
    second, first = drive_names(side, gripper)
    both = spec.add_equality(type=mjtEq.mjEQ_JOINT, name1=first, name2=second)
    both.objtype, both.data = mjtObj.mjOBJ_JOINT, [0, 1] + [0] * 10
    servo = spec.add_actuator(name=prefix, target=prefix, trntype=mjtTrn.mjTRN_TENDON)
    servo.set_to_position(kp=20_000.0)
    servo.gainprm[0] *= gripper.stroke
    servo.ctrlrange, servo.ctrllimited = (0, 1), True
    servo.forcerange, servo.forcelimited = (-gripper.force, gripper.force), True
