"""A page for other machines: encrypted, by a certificate made for it."""

import hashlib
import ssl
import sys
from contextlib import closing
from urllib.parse import urlsplit

import pytest

from duobench.cli.shared.page import PageOptions
from duobench.core.errors import ServingError
from duobench.web.access import make_certificate, own_hosts
from duobench.web.server import PageServer
from tests.web.pages import open_page


def test_without_the_package_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "trustme", None)
    with pytest.raises(ServingError, match=r"trustme makes.*pip install '\.\[teleop\]'"):
        make_certificate()


def test_this_machine_has_a_name_for_others() -> None:
    assert {"127.0.0.1", "localhost"} < set(own_hosts())


def test_a_page_is_encrypted_for_every_host_of_its_certificate() -> None:
    pytest.importorskip("trustme", reason="trustme is not installed here: make setup-test")
    server = PageServer(
        {}, host="0.0.0.0", certificate=make_certificate(["127.0.0.1", "robot.example"])
    )
    parts = urlsplit(server.url)
    assert parts.scheme == "https"
    assert parts.hostname == "robot.example"
    trusting = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE
    url = server.url.replace("robot.example", "127.0.0.1")
    with open_page(url, context=trusting) as page:
        assert page.hear_of("role")["viewers"] == 1
        shown = ssl.DER_cert_to_PEM_cert(
            page.connection.socket.getpeercert(binary_form=True)  # pyright: ignore[reportAttributeAccessIssue]
        )
        assert shown.startswith("-----BEGIN CERTIFICATE")
    server.close()


def test_the_fingerprint_that_is_printed_is_the_one_that_a_browser_shows(
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("trustme", reason="trustme is not installed here: make setup-test")
    with closing(PageOptions(lan=True).serve()) as server:
        shown = ssl.get_server_certificate(("127.0.0.1", urlsplit(server.url).port or 0))
    digest = hashlib.sha256(ssl.PEM_cert_to_DER_cert(shown)).hexdigest().upper()
    assert capsys.readouterr().out.split()[-1].replace(":", "") == digest


def test_a_host_that_is_none() -> None:
    pytest.importorskip("trustme", reason="trustme is not installed here: make setup-test")
    with pytest.raises(ServingError, match="There is no certificate for a b"):
        make_certificate(["a b"])
