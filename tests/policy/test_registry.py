from pathlib import Path

import pytest

from duobench.core.errors import PolicyError
from duobench.policy import HoldPolicy, make
from duobench.policy.registry import PolicyKind, kind_of, source_version
from duobench.policy.serving.address import WORDS

MODULE = """
from duobench.policy import HoldPolicy, PolicyMetadata

class Mine(HoldPolicy):
    metadata = PolicyMetadata(name="mine")

def make_policy():
    return Mine()

def make_nothing():
    return object()

class Needs:
    def __init__(self):
        raise OSError("no weights")

class Leaves:
    def __init__(self):
        raise SystemExit(3)

A_NUMBER = 3
"""


@pytest.fixture
def own_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "own_policies.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    return "own_policies"


@pytest.mark.parametrize("attribute", ["Mine", "make_policy"])
def test_class_or_function_of_a_module_makes_a_policy(own_module: str, attribute: str) -> None:
    policy = make(f"{own_module}:{attribute}")
    assert isinstance(policy, HoldPolicy)
    assert policy.metadata.name == "mine"


@pytest.mark.parametrize(
    ("attribute", "message"),
    [
        ("Mein", "'Mein'. Did you mean 'Mine'.*Leaves, Mine, Needs, make_nothing, make_policy"),
        ("A_NUMBER", "own_policies, whose A_NUMBER is of type int, has no class or function"),
        ("make_nothing", "gave a object, which is no policy"),
        (
            "Needs",
            r"(?s)Needs' cannot be made\..*\n  File .*own_policies\.py.*\nOSError: no weights",
        ),
        ("Leaves", r"(?s)Leaves' cannot be made\..*SystemExit: 3"),
    ],
)
def test_attribute_that_makes_no_policy_is_refused_with_the_traceback_of_its_maker(
    own_module: str, attribute: str, message: str
) -> None:
    with pytest.raises(PolicyError, match=message) as told:
        make(f"{own_module}:{attribute}")
    assert "registry.py" not in str(told.value)


@pytest.mark.parametrize("name", [":", ":x", "module:", ".:x", "..module:x"])
def test_half_a_name_is_refused(name: str) -> None:
    with pytest.raises(PolicyError, match="is no `module:attribute`, such as"):
        make(name)


def test_version_of_a_source_changes_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "versioned.py").write_text("from duobench.policy import HoldPolicy as Mine\n")
    make("versioned:Mine")
    before = source_version("versioned")
    assert before
    assert before == source_version("versioned", "versioned")
    assert before != source_version("versioned", "duobench.policy.baselines")
    (tmp_path / "versioned.py").write_text("from duobench.policy import ZeroPolicy as Mine\n")
    assert source_version("versioned") not in (before, None)


@pytest.mark.parametrize("module", ["sys", "no_such_module"])
def test_module_without_a_source_has_no_version(module: str) -> None:
    assert source_version(module) is None


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("expert", PolicyKind.EXPERT),
        ("expert:human", PolicyKind.EXPERT),
        ("blind", PolicyKind.BLIND),
        ("hold", PolicyKind.BASELINE),
        ("lerobot:runs/a:b", PolicyKind.LEROBOT),
        ("no_such_module:Mine", PolicyKind.MODULE),
        ("blind:x", PolicyKind.MODULE),
        ("openpi", PolicyKind.SERVED),
    ],
)
def test_kind_follows_from_the_name_alone(name: str, kind: PolicyKind) -> None:
    assert kind_of(name, WORDS) is kind
    assert PolicyKind(str(kind)) is kind


def test_policy_that_reads_the_simulation_sees_no_images_and_has_no_process() -> None:
    for kind in PolicyKind:
        assert not (kind.is_scripted and (kind.may_see or kind.has_process))
