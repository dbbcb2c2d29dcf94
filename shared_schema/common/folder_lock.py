"""Lock of a folder that one process at a time may write to, on local and on shared file systems.

The folder holds a file ``.lock`` as long as its owner works. Two signs say that the owner lives:

1. a lock of the operating system on the file (``flock``), which ends with its process; Windows
   does not have it, nor do some file systems of clusters (Lustre without ``flock``), others have it
   only among the processes of one machine (Lustre with ``localflock``, BeeGFS);
2. the heartbeat: the owner counts in the file every `BEAT` seconds.

On the owner's machine the first sign decides, if there is one; elsewhere the second: an owner whose
count stands still for `DEAD_AFTER` seconds is dead, and its lock is taken over.
"""

from __future__ import annotations

import errno
import os
import socket
import threading
import time
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from shared_schema.common.errors import InputError

with suppress(ModuleNotFoundError):  # Windows has none
    import fcntl

LOCK = ".lock"
WAIT = 3.0  # seconds that the processes of a killed program may take to end
BEAT = 5.0  # seconds between two heartbeats
DEAD_AFTER = 30.0  # seconds without a heartbeat after which an owner counts as dead
POLL = 0.05  # seconds between two looks at a lock
WITHOUT = (errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOLCK, errno.EINVAL, errno.EBADF)  # no `flock`
LOCKS = "fcntl" in globals()
BOOT = Path("/proc/sys/kernel/random/boot_id")  # of Linux


class FolderLock:
    """Context in which this process alone works in a folder; it may be entered once.

    Parameters
    ----------
    folder : Path
        It is made if it does not exist.
    option : str
        Option of the command line that names the folder, for the error message.

    Raises
    ------
    InputError
        On entering, if another process works in the folder.
    OSError
        On entering, if the folder or the lock cannot be made.
    """

    def __init__(self, folder: Path, option: str = "--out") -> None:
        self._folder, self._option = folder, option
        self._path = folder / LOCK
        self._file: int | None = None
        self._ended = threading.Event()
        self._heart = threading.Thread(target=self._beat, daemon=True)

    def __enter__(self) -> FolderLock:
        self._folder.mkdir(parents=True, exist_ok=True)
        limit = time.monotonic() + WAIT
        while not self._taken():
            if time.monotonic() > limit:
                owner = _owner(_content(self._path))
                raise InputError(
                    f"{self._option} '{self._folder}': another run is working in it{owner}"
                )
            time.sleep(POLL)
        self._heart.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        assert self._file is not None
        self._ended.set()
        self._heart.join()  # before its file is closed, whose number may then be another file's
        if not LOCKS:  # Windows removes no open file
            os.close(self._file)
        with suppress(OSError):  # a disk that became read-only; the lock is dead nevertheless
            self._path.unlink()
        if LOCKS:
            os.close(self._file)

    def _taken(self) -> bool:
        """Try once to take the lock; True if this process owns it."""
        try:
            file, is_new = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o644), True
        except FileExistsError:
            try:
                file, is_new = os.open(self._path, os.O_RDWR), False
            except FileNotFoundError:  # released in this moment
                return False
        try:
            locked = _flock(file)
            free = locked is not False and _is_at(file, self._path)
            if free and (is_new or self._is_dead(file, locked=bool(locked))):
                self._write_name(file)
                if is_new or self._is_still_ours():
                    self._file, file = file, -1
                    return True
            return False
        finally:
            if file >= 0:
                os.close(file)

    def _write_name(self, file: int) -> None:
        try:
            _write(file, 0)
        except OSError as error:
            self._path.unlink()
            raise OSError(error.errno, error.strerror, str(self._path)) from error

    def _is_still_ours(self) -> bool:
        """True unless another process took over the same dead lock in the same moment."""
        time.sleep(POLL)
        return _content(self._path) == _text(0)

    def _is_dead(self, file: int, locked: bool) -> bool:
        """True if the owner that the lock names is dead; waits for a heartbeat if it must."""
        found = _content(self._path)
        if locked and found.split()[2:3] == [_boot()]:
            return True
        patience = DEAD_AFTER if found else POLL + 1.0  # an owner that has yet to write its name
        limit = time.monotonic() + patience
        while time.monotonic() < limit:
            time.sleep(min(POLL, patience))
            if _content(self._path) != found or not _is_at(file, self._path):
                return False
        return True

    def _beat(self) -> None:
        count = 0
        while not self._ended.wait(BEAT):
            count += 1
            assert self._file is not None
            with suppress(OSError):  # a full disk
                _write(self._file, count)


def _flock(file: int) -> bool | None:
    """Lock a file; False if another process has it, None where there are no locks."""
    if not LOCKS:
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno not in WITHOUT:
            raise
        return None
    return True


def _is_at(file: int, path: Path) -> bool:
    """True if an open file still has its name."""
    try:
        return os.path.samestat(os.fstat(file), path.stat())
    except FileNotFoundError:
        return False


def _write(file: int, count: int) -> None:
    """Write the owner's name and heartbeat over those before."""
    text = _text(count).encode()
    os.lseek(file, 0, os.SEEK_SET)
    os.write(file, text)
    os.ftruncate(file, len(text))


def _text(count: int) -> str:
    """Content of a lock: machine, process, boot, and the count of the heartbeat."""
    return f"{socket.gethostname()} {os.getpid()} {_boot()} {count:012d}\n"


def _content(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _owner(content: str) -> str:
    """Name of the owner for a message, from the content of its lock."""
    words = content.split()
    return f" (process {words[1]} on {words[0]})" if len(words) == 4 else ""


def _boot() -> str:
    """Identity of this machine since it was started; also that of all its containers."""
    return BOOT.read_text().strip() if BOOT.is_file() else socket.gethostname()
