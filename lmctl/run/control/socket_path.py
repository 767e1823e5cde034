"""Where a run's control socket is, and whether a process listens on it.

It lies in the run's folder as `control.sock`. A path of a Unix socket takes 107 bytes (103 on
macOS): where the folder's is longer, or its file system holds no sockets, `control.sock` is a link
to one in the user's run-time folder.
"""

from __future__ import annotations

import errno
import hashlib
import os
import socket
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

from lmctl.errors import JournalError
from lmctl.run.journal.run_folders import RunFolder

SOCKET_NAME = "control.sock"
_MAX_PATH = 103
_NO_SOCKETS_HERE = (errno.EPERM, errno.EOPNOTSUPP, errno.ENOTSUP, errno.EINVAL)
_BACKLOG = 8
_ANSWER_S = 5.0


def open_listening_socket(folder: Path) -> socket.socket:
    """A listening socket for the run in `folder`, which only its owner can connect to.

    One left there by a dead process is removed first. Raises JournalError where a living process
    listens there, or no socket can be made.
    """
    path = folder.absolute() / SOCKET_NAME
    if (running := connect_to_run(folder)) is not None:
        running.close()
        raise JournalError(f"another process already drives {folder.name}", where=str(path),
                           hint=f"`{RunFolder(folder).command('status')}` shows how far it is")
    try:
        if len(os.fsencode(path)) <= _MAX_PATH:
            try:
                return _bound(path)
            except OSError as error:
                if error.errno not in _NO_SOCKETS_HERE:
                    raise
        real = _run_time_folder() / hashlib.sha256(os.fsencode(path)).hexdigest()[:24]
        real.unlink(missing_ok=True)
        listening = _bound(real)
        path.symlink_to(real)
        return listening
    except OSError as error:
        raise JournalError(f"no control socket can be made for {folder.name}",
                           where=f"{path}: {error.strerror or error}",
                           hint="choose a folder of runs on a local disk with --runs") from None


def connect_to_run(folder: Path) -> socket.socket | None:
    """A connection to the run in `folder`, or None where no process drives it.

    A socket whose process has died is removed. Raises JournalError where it is another user's.
    """
    path = folder / SOCKET_NAME
    if not os.path.lexists(path):
        return None
    client = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    client.settimeout(_ANSWER_S)
    try:
        client.connect(os.readlink(path) if path.is_symlink() else str(path))
        return client
    except (ConnectionRefusedError, FileNotFoundError):
        client.close()
        remove_socket(folder)
        return None
    except OSError as error:
        client.close()
        raise JournalError(
            f"{folder.name} cannot be reached", where=f"{path}: {error.strerror or error}",
            hint="only the user who runs it may drive it",
        ) from None


def remove_socket(folder: Path) -> None:
    """Remove the socket of a run that has ended, and the link to it."""
    path = folder / SOCKET_NAME
    for place in (Path(os.path.realpath(path)), path):
        try:
            if stat.S_ISSOCK(place.lstat().st_mode) or place.is_symlink():
                place.unlink()
        except OSError:
            pass  # it is gone, or not ours to remove


def _bound(path: Path) -> socket.socket:
    """A socket that listens at `path`, which only its owner can connect to.

    It gets its name once it listens: a client that met it before would take its process for dead.
    Until then its name is made from its own, since many runs share the run-time folder.
    """
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    new = path.with_suffix(".new")
    before = os.umask(0o177)  # there must be no moment in which others could connect
    try:
        new.unlink(missing_ok=True)
        listening.bind(str(new))
        listening.listen(_BACKLOG)
        new.rename(path)
    except BaseException:
        listening.close()
        with suppress(OSError):  # there is none, and the first error is more useful
            new.unlink(missing_ok=True)
        raise
    finally:
        os.umask(before)
    listening.setblocking(False)
    return listening


def _run_time_folder() -> Path:
    """A folder of the user's own. Raises OSError, also where another user owns it."""
    base = Path(os.environ.get("XDG_RUNTIME_DIR", ""))
    if base.is_absolute() and base.is_dir():
        folder = base / "lmctl"
    else:  # not set, or of a session that has ended (sudo, cron)
        folder = Path(tempfile.gettempdir()) / f"lmctl-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise PermissionError(errno.EPERM, f"{folder} is not a folder of this user's alone")
    return folder
