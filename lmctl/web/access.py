"""Who may read and who may act: tokens of viewers and operators, and the hosts a page answers as.

Tokens come in the header `Authorization: Bearer TOKEN` and nowhere else. Browsers send it only when
a script of this page does, so no other page can act in an operator's name.
"""

from __future__ import annotations

import hmac
import secrets
import stat
from dataclasses import dataclass
from enum import IntEnum
from hashlib import sha256
from pathlib import Path

from lmctl.errors import ConfigError, MissingFileError, UsageError

#: Shorter tokens can be guessed.
LEAST_TOKEN_LENGTH = 20
_MOST_TOKEN_LENGTH = 200

LOOPBACK_HOSTS = frozenset({"127.0.0.1", "localhost", "::1"})


class AccessRole(IntEnum):
    """What a request may do; each role may do what the one before may."""

    NONE = 0
    VIEWER = 1
    OPERATOR = 2


@dataclass(frozen=True)
class AccessPolicy:
    """The tokens of a page.

    viewer_token : None where reading needs no token, which only a page on this machine may have
    host_names : names the page may be asked by, None for any. Where reading needs no token, another
        name is that of a foreign site that has been made to point here
    """

    operator_token: str
    viewer_token: str | None = None
    host_names: frozenset[str] | None = LOOPBACK_HOSTS

    def role_of(self, authorization: str | None) -> AccessRole:
        """The role of a request, by its Authorization header; takes the same time for any token."""
        if authorization is None:
            return AccessRole.VIEWER if self.viewer_token is None else AccessRole.NONE
        scheme, _, given = authorization.partition(" ")
        digest = _digest(given.strip()[:_MOST_TOKEN_LENGTH])
        is_operator = hmac.compare_digest(digest, _digest(self.operator_token))
        is_viewer = hmac.compare_digest(digest, _digest(self.viewer_token or ""))
        if scheme.lower() != "bearer" or not given:
            return AccessRole.NONE
        if is_operator:
            return AccessRole.OPERATOR
        return AccessRole.VIEWER if is_viewer and self.viewer_token else AccessRole.NONE


def access_policy(
    host: str, operator_file: Path | None, viewer_file: Path | None
) -> AccessPolicy:
    """The policy of a page that listens on a host.

    On this machine reading needs no token unless there is one, and a missing operator's token is
    made up. Elsewhere both are needed. Raises UsageError, ConfigError, MissingFileError.
    """
    is_local = host in LOOPBACK_HOSTS
    if not is_local and (operator_file is None or viewer_file is None):
        raise UsageError(
            f"on {host} others can reach this page: it needs tokens",
            hint="give --operator-token FILE and --viewer-token FILE, each with a text of at least "
            f"{LEAST_TOKEN_LENGTH} characters, as `openssl rand -hex 24` prints one")
    operator = new_token() if operator_file is None else read_token(operator_file)
    viewer = None if viewer_file is None else read_token(viewer_file)
    if operator == viewer:
        raise ConfigError("operator and viewer have the same token",
                          where=f"{operator_file}, {viewer_file}",
                          hint="a viewer must not be able to act: make another one")
    return AccessPolicy(operator, viewer, LOOPBACK_HOSTS if is_local else None)


def read_token(path: Path) -> str:
    """The token in a file that only its owner can read. Raises ConfigError, MissingFileError."""
    try:
        mode = path.stat().st_mode
        token = path.read_text("utf-8").strip()
    except FileNotFoundError:
        raise MissingFileError.for_path(path) from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read the token in {path}", where=str(error),
                          hint="check that it is there and that you may read it") from None
    wrong = []
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        wrong.append(f"others can read it: `chmod 600 {path}`")
    if not LEAST_TOKEN_LENGTH <= len(token) <= _MOST_TOKEN_LENGTH:
        wrong.append(f"it has {len(token)} characters, and needs {LEAST_TOKEN_LENGTH} to "
                     f"{_MOST_TOKEN_LENGTH}")
    if not token.isascii() or not token.isprintable() or " " in token:
        wrong.append("a token is printable ASCII without spaces")
    if wrong:
        raise ConfigError(f"{path} holds no usable token", where=wrong,
                          hint=f"write a random one into it: `openssl rand -hex 24 > {path}`, and "
                          "let nobody else read it")
    return token


def new_token() -> str:
    """A new random token of 192 bits."""
    return secrets.token_urlsafe(24)


def _digest(token: str) -> bytes:
    return sha256(token.encode("utf-8", "surrogateescape")).digest()
