"""Names are checked before anything large is loaded, and what is missing is shown by an example."""

import inspect

import pytest

from duobench.cli.program import GROUPS, VERBS
from duobench.cli.shared.options import options_of
from duobench.cli.shared.spelling import EXAMPLES, FIRST, NAMED, TRAINED, check_spelling
from duobench.policy.training.recipes import OBJECT_STATES, RECIPES
from tests.children import ran
from tests.cli.conftest import refusal

LARGE = ("mujoco", "tyro", "rich", "PIL", "trimesh", "duobench.cli.program", "duobench.world.sim")
PROBE = f"""
import sys
from duobench.cli import main
try:
    main()
finally:
    print([name for name in {LARGE} if name in sys.modules])
"""
EVERY = {f"duobench {name}": verb for name, verb in VERBS.items() if name not in GROUPS} | {
    f"duobench {group} {name}": verb
    for group, verbs in GROUPS.items()
    for name, verb in verbs.items()
    if f"{group} {name}" not in GROUPS
}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("eval --policy hold --out x --tasks carry_pot bin_sorts", "Did you mean 'bin_sort'"),
        ("eval --out x --policy=hodl", "Did you mean 'hold'"),
        ("eval --policy hold --out x --suite papr", "Did you mean 'paper'"),
        ("eval --policy hold --out x --look drak", "Did you mean 'dark'"),
        ("record --out x --tasks bin_sorts", "Did you mean 'bin_sort'"),
        ("record --out x --policy exprt", "Did you mean 'expert'"),
        ("render carry_pto", "Did you mean 'carry_pot'"),
        ("view carry_pto", "Did you mean 'carry_pot'"),
        ("teleop carry_pto --out x", "Did you mean 'carry_pot'"),
        ("serve --policy hodl", "Did you mean 'hold'"),
    ],
)
def test_a_misspelt_name_is_told_before_anything_large_is_loaded(words: str, message: str) -> None:
    done = ran("-c", PROBE, *words.split())
    assert (done.returncode, done.stdout) == (1, "[]\n"), done.stderr
    assert message in done.stderr


@pytest.mark.parametrize("verb", NAMED)
def test_what_is_checked_is_what_the_verb_takes(verb: str) -> None:
    options = list(options_of(VERBS[verb]))
    assert {option.flag for option in options} >= NAMED[verb].keys() - {FIRST}
    assert any(option.is_first for option in options) >= (FIRST in NAMED[verb])


@pytest.mark.parametrize("program", EVERY)
def test_a_verb_that_needs_arguments_shows_some_that_are_enough(program: str) -> None:
    verb, words = EVERY[program], program.split()[1:]
    needed = [one for one in options_of(verb) if one.default is inspect.Parameter.empty]
    short = program.removeprefix("duobench ")
    assert needed or short not in EXAMPLES
    if needed:
        assert f"; see: {program} {EXAMPLES.get(short, '--help')}" in refusal(*words)
        check_spelling([words[-1], *EXAMPLES.get(short, "--help").split()], {words[-1]: verb}, "")


def test_kinds_of_policies_that_are_trained_are_those_of_the_recipes() -> None:
    assert sorted(TRAINED) == sorted({*RECIPES, *OBJECT_STATES})
