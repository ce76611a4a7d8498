"""Where VLAgents is missing or of another version, a sentence says so; nothing else needs it."""

from importlib.metadata import PackageNotFoundError

import pytest

from duobench.core.errors import DuoBenchError
from duobench.evaluation.interop import vlagents
from duobench.policy import make


@pytest.mark.parametrize(
    ("versions", "told"),
    [
        ({}, "vlagents is not installed"),
        ({"vlagents": "0.2.0", "rpyc": "6.0.2"}, "vlagents 0.2.0 is installed"),
        ({"vlagents": "0.4.0", "rpyc": "6.0.2"}, "vlagents 0.4.0 is installed"),
        ({"vlagents": "0.30.0", "rpyc": "6.0.2"}, "vlagents 0.30.0 is installed"),
        ({"vlagents": "0.3.0", "rpyc": "5.3.1"}, "rpyc 5.3.1 is installed"),
    ],
)
def test_other_versions_are_refused_by_name(
    monkeypatch: pytest.MonkeyPatch, versions: dict[str, str], told: str
) -> None:
    installed = {"vlagents": "0.3.1", "rpyc": "6.0.2"}

    def version(name: str) -> str:
        if name not in installed:
            raise PackageNotFoundError(name)
        return installed[name]

    monkeypatch.setattr(vlagents, "version", version)
    vlagents.check_versions()
    installed = versions
    with pytest.raises(DuoBenchError, match=f"{told}.*pip install"):
        make("duobench.evaluation.interop.vlagents:served_agent")
