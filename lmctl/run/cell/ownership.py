"""Who drives a machine: one lock an endpoint, for the whole host, gone with the process holding it.

A journal's own lock keeps two processes from one run; these keep two runs from one cell. What is
locked is the endpoint, not the profile's name: two profiles of one cell share its wires, and two
simulated cells of one profile share nothing. A host elsewhere on the network cannot be seen; there
the controller's own refusal of a second connection has to do.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import stat
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from lmctl.config.machine import MachineProfile
from lmctl.errors import MachineError
from lmctl.machine.modbus.endpoint import RtuEndpoint, parse_modbus_endpoint
from lmctl.machine.motion.endpoint import MotionEndpoint, parse_motion_endpoint
from lmctl.run.journal.run_folders import command_line

#: Where lock files are, the first that all users may write to: one place for all users and
#: processes of a host, and so nothing that a user's environment names (TMPDIR).
FOLDERS = (Path("/run/lock"), Path("/tmp"))

#: More than any claim; the rest of a longer file is not ours.
_CLAIM_BYTES = 4096


@dataclass(frozen=True)
class MachineOwner:
    """Who holds a lock.

    activity : "run-0003", or the act in words; runs_dir : its folder of runs
    """

    activity: str
    runs_dir: str
    pid: int


@contextmanager
def lock_machine(profile: MachineProfile, what: str, runs_dir: Path) -> Iterator[None]:
    """Have the machine of a profile to oneself while the context lasts.

    what : who is to be named to those who come second
    Raises MachineError where another process has one of its endpoints, ConfigError for a bad one.
    """
    wires = {_wire(text): text for text in _endpoints(profile)}
    claim = MachineOwner(what, str(runs_dir.resolve()), os.getpid())
    with ExitStack() as held:
        for wire in sorted(wires):  # in one order, so that two who come at once see each other
            path = _folder() / _file_name(wire)
            fd = _take(path, wires[wire])
            held.callback(_release, path, fd)
            os.ftruncate(fd, 0)
            os.pwrite(fd, json.dumps(asdict(claim)).encode(), 0)
        yield


def owner_of(profile: MachineProfile) -> MachineOwner | None:
    """Who has the machine of a profile now, or None. Raises ConfigError for a bad endpoint."""
    for text in _endpoints(profile):
        path = _folder() / _file_name(_wire(text))
        try:
            fd = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
        except OSError:
            continue
        try:
            fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return _claim(fd)
        finally:
            os.close(fd)
    return None


def _endpoints(profile: MachineProfile) -> list[str]:
    safety = [profile.safety.endpoint] if profile.safety else []
    return [profile.motion.endpoint, *(feeder.endpoint for feeder in profile.feeder), *safety]


def _wire(endpoint: str) -> str:
    """One spelling for all the ways to write an endpoint. Raises ConfigError."""
    where = (
        parse_modbus_endpoint(endpoint) if endpoint.startswith("modbus-")
        else parse_motion_endpoint(endpoint)
    )
    if isinstance(where, RtuEndpoint) or (isinstance(where, MotionEndpoint) and where.path):
        return os.path.realpath(where.path)  # /dev/serial/by-id/... is a link
    host = "127.0.0.1" if where.host.lower() == "localhost" else where.host.lower()
    return f"{host}:{where.port}"


def _folder() -> Path:
    """Where the locks of all users of this host are, made where missing. Raises MachineError."""
    folder = next(filter(_is_shared, FOLDERS), FOLDERS[-1]) / "lmctl-locks"
    try:
        folder.mkdir()
        folder.chmod(0o1777)  # any user may drive the cell; only a file's owner may remove it
    except FileExistsError:
        pass
    except OSError as error:
        raise _no_lock(folder, error) from None
    if folder.is_symlink() or not folder.is_dir():
        raise MachineError(f"{folder} is not a folder: no lock can be had on the machine",
                           hint="remove it, then try again")
    return folder


def _is_shared(folder: Path) -> bool:
    """By its mode, not by the calling user: all users must get the same answer."""
    try:
        return bool(folder.stat().st_mode & stat.S_IWOTH)
    except OSError:
        return False


def _file_name(wire: str) -> str:
    plain = "".join(c if c.isalnum() or c == "." else "-" for c in wire).strip("-")[-60:]
    return f"{plain}-{hashlib.sha256(wire.encode()).hexdigest()[:8]}"


def _take(path: Path, endpoint: str) -> int:
    """Lock the file, made where missing. Raises MachineError where another process has it."""
    while True:
        try:
            fd = _open(path)
        except FileNotFoundError:
            continue  # let go of by its owner in this moment
        except OSError as error:
            raise _no_lock(path, error) from None
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = _claim(fd)
            os.close(fd)
            raise _refusal(owner, endpoint) from None
        if _is_still(path, fd):
            return fd
        os.close(fd)  # removed by its owner between opening and locking it


def _open(path: Path) -> int:
    try:
        fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o666)
    except FileExistsError:
        return os.open(path, os.O_RDWR | os.O_NOFOLLOW)
    os.fchmod(fd, 0o666)  # the next to take it may be another user, whatever our umask
    return fd


def _is_still(path: Path, fd: int) -> bool:
    try:
        there, ours = os.stat(path), os.fstat(fd)
    except FileNotFoundError:
        return False
    return (there.st_dev, there.st_ino) == (ours.st_dev, ours.st_ino)


def _release(path: Path, fd: int) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError:
        pass  # another user's file: unlocked, it blocks no one
    finally:
        os.close(fd)


def _claim(fd: int) -> MachineOwner:
    try:
        said = json.loads(os.pread(fd, _CLAIM_BYTES, 0))
        return MachineOwner(str(said["activity"]), str(said["runs_dir"]), int(said["pid"]))
    except (OSError, ValueError, TypeError, KeyError):
        return MachineOwner("another process", "", 0)


def _refusal(owner: MachineOwner, endpoint: str) -> MachineError:
    run = owner.activity.startswith("run-")
    where = [f"at {endpoint}"]
    if owner.pid:
        where.append(f"process {owner.pid}, runs in {owner.runs_dir}")
    return MachineError(
        f"{owner.activity} has the machine", where=where,
        hint=f"`{command_line('status', Path(owner.runs_dir), owner.activity)}` "
             "shows how far it is" if run else "wait until it is done",
    )


def _no_lock(path: Path, error: OSError) -> MachineError:
    return MachineError("no lock can be had on the machine",
                        where=f"{path}: {error.strerror}", hint="mend its permissions")
