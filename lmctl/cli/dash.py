"""`lmctl dash`: the live page of a folder of runs, and doors for other programs."""

from __future__ import annotations

from pathlib import Path

import click

from lmctl.cli.console import print_data, print_message
from lmctl.cli.paths import InputFile
from lmctl.errors import UsageError


@click.command()
@click.argument("runs_dir", metavar="[RUNS]", default=Path("runs"),
                type=click.Path(file_okay=False, path_type=Path))
@click.option("--host", default="127.0.0.1", show_default=True,
              help="Address to listen on. Another than this machine's own needs tokens.")
@click.option("--port", type=click.IntRange(0, 65535), default=8440, show_default=True,
              help="0 for any free port.")
@click.option("--operator-token", type=InputFile(),
              help="File with the token of those who may act [made up on this machine].")
@click.option("--viewer-token", type=InputFile(),
              help="File with the token of those who may look [not needed on this machine].")
@click.option("--tls-cert", type=InputFile(), help="Certificate for https, a PEM file.")
@click.option("--tls-key", type=InputFile(), help="Its key, a PEM file.")
@click.option("--shdr", "shdr_port", type=click.IntRange(0, 65535), metavar="PORT",
              help="Serve an MTConnect agent on this port, too (SHDR; reading only).")
@click.option("--opcua", "opcua_port", type=click.IntRange(0, 65535), metavar="PORT",
              help="Serve OPC UA clients on this port, too (reading only).")
def dash(
    runs_dir: Path, host: str, port: int, operator_token: Path | None, viewer_token: Path | None,
    tls_cert: Path | None, tls_key: Path | None, shdr_port: int | None, opcua_port: int | None,
) -> None:
    """Serve the live page of the runs in RUNS [runs], until Ctrl-C.

    It only reads journals and asks runs for their state: stopping it does nothing to a run. Its
    stop button is no emergency stop.
    """
    if (tls_cert is None) != (tls_key is None):
        raise UsageError("https needs both --tls-cert and --tls-key",
                         hint="they name PEM files: the certificate, and the key it was made with")
    from lmctl.web import DashSettings, access_policy, run_dash
    from lmctl.web.access import LOOPBACK_HOSTS

    policy = access_policy(host, operator_token, viewer_token)
    is_local = host in LOOPBACK_HOSTS
    if not is_local and (shdr_port is not None or opcua_port is not None):
        raise UsageError("--shdr and --opcua have no tokens, so they are served on this machine "
                         "only", hint="run a second `lmctl dash` on 127.0.0.1 for them, behind a "
                         "gateway of your own")
    if not is_local and tls_cert is None:
        print_message("warning: without --tls-cert tokens and acts travel in clear text")

    def say_where(doors: dict[str, str]) -> None:
        operator = f"{doors['page']}#token={policy.operator_token}"
        print_data(f"live page of {runs_dir}: {doors['page']}")
        if operator_token is None:
            print_data(f"  to operate: {operator}")
        for name in ("shdr", "opcua"):
            if name in doors:
                print_data(f"  {name}: {doors[name]}")
        print_message("Ctrl-C ends the page; runs go on. Its stop is no emergency stop.")

    run_dash(runs_dir, DashSettings(host, port, tls_cert, tls_key, shdr_port, opcua_port),
             policy, say_where)
