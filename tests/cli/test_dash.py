"""`lmctl dash`: what it refuses before it listens, where it says it listens, and https."""

from __future__ import annotations

import socket
import ssl
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

OPERATOR, VIEWER = "operator-token-0123456789", "viewer-token-0123456789"


@pytest.fixture
def tokens(tmp_path: Path) -> list[str]:
    """Options that name two good token files."""
    options = []
    for name, token in (("operator", OPERATOR), ("viewer", VIEWER)):
        (tmp_path / name).write_text(token)
        (tmp_path / name).chmod(0o600)
        options += [f"--{name}-token", str(tmp_path / name)]
    return options


@pytest.mark.parametrize(("options", "code", "words"), [
    (["--host", "0.0.0.0"], 2, ("it needs tokens", "openssl rand")),
    (["--tls-cert", "cert.pem"], 2, ("no file cert.pem",)),
    (["--operator-token", "nowhere"], 2, ("no file nowhere",)),
    (["--port", "70000"], 2, ("70000",)),
    (["--host", "256.1.1.1", "TOKENS"], 2, ("cannot listen on 256.1.1.1",)),
    (["--host", "0.0.0.0", "--shdr", "7878", "TOKENS"], 2, ("on this machine only",)),
])
def test_it_refuses_what_would_be_open_to_others_or_cannot_be(
    refused, tokens, options, code, words
) -> None:
    given = [one for option in options for one in (tokens if option == "TOKENS" else [option])]
    text = refused("dash", *given, code=code)
    for one in words:
        assert one in text


def test_https_needs_both_files_and_files_that_are_meant(refused, tmp_path: Path) -> None:
    for name in ("cert.pem", "key.pem"):
        (tmp_path / name).write_text("no certificate\n")
    assert "both --tls-cert and --tls-key" in refused("dash", "--tls-cert", "cert.pem", code=2)
    text = refused("dash", "--port", "0", "--tls-cert", "cert.pem", "--tls-key", "key.pem", code=2)
    assert "cannot be used" in text
    assert "PEM files that belong together" in text


@pytest.mark.parametrize("option", ["--port", "--shdr"])
def test_a_port_in_use_is_named_with_what_to_do(refused, option) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        options = [option, port] + ([] if option == "--port" else ["--port", "0"])
        text = refused("dash", *options, code=2)
    assert f"cannot listen on 127.0.0.1 port {port}" in text
    assert f"{option} names another port" in text


def test_over_https_a_viewer_reads_with_its_token(tmp_path: Path, tokens) -> None:
    made = subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256",
         "-nodes", "-keyout", "key.pem", "-out", "cert.pem", "-days", "2", "-subj", "/CN=localhost",
         "-addext", "subjectAltName=IP:127.0.0.1"], cwd=tmp_path, capture_output=True, check=False)
    if made.returncode:
        pytest.skip("openssl cannot make a certificate here")
    page = subprocess.Popen(
        [sys.executable, "-m", "lmctl.cli", "dash", "--port", "0", "--tls-cert", "cert.pem",
         "--tls-key", "key.pem", *tokens], cwd=tmp_path, text=True, stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL)
    try:
        assert page.stdout is not None
        url = page.stdout.readline().split()[-1]
        assert url.startswith("https://127.0.0.1:")
        with httpx.Client(verify=ssl.create_default_context(cafile=tmp_path / "cert.pem")) as web:
            assert web.get(url + "api/runs").status_code == 401
            found = web.get(url + "api/runs", headers={"Authorization": f"Bearer {VIEWER}"})
            assert found.json() == {"runs": []}
        with pytest.raises(httpx.TransportError):
            httpx.get(url.replace("https", "http"), verify=False)
    finally:
        page.terminate()
        out, _ = page.communicate(timeout=20)
    assert page.returncode in (0, -15)
    assert OPERATOR not in out
