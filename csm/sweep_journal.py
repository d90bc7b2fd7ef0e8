"""The journal of a sweep: one line of JSON for every finished point, safe against a kill."""

import fcntl
import json
import math
import os
import warnings
from pathlib import Path

__all__ = ["FAILED", "INVALID", "LOST", "OK", "Journal", "blank_record"]

# What became of a point.
OK = "ok"
INVALID = "invalid"  # no such settings
FAILED = "failed"  # refused by the driver, out of memory …: it will be again
LOST = "lost"  # the process that worked on it died; tried again when the sweep is resumed

FINISHED = (OK, FAILED)


class Journal:
    """Records of finished points by key, in memory and, with a folder, in a file.

    A record is written as one line with one call and flushed to the system, so it is there whatever
    then happens to the process. What a kill leaves of a last line is cut off when the journal is
    opened again. One process may hold a journal at a time.

    Parameters
    ----------
    path : path, optional
        Made with its folder if new. Without it records are kept in memory alone.

    Raises
    ------
    BlockingIOError
        If another process has the journal open.
    OSError
        If the file cannot be written.
    """

    def __init__(self, path=None):
        self._records = {}
        self._file = None
        if path is None:
            return
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = open(path, "a+b", buffering=0)
        try:
            self._hold(path)
            self._read(path)
        except BaseException:
            self.close()
            raise

    def _hold(self, path):
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BlockingIOError(f"{path}: another sweep is writing to this folder") from None

    def _read(self, path):
        self._file.seek(0)
        content = self._file.read()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            os.ftruncate(self._file.fileno(), whole)
        spoilt = 0
        for line in content[:whole].splitlines():
            try:
                record = json.loads(line)
                self._records[record["key"]] = record
            except (ValueError, KeyError, TypeError):
                spoilt += 1
        if spoilt:
            warnings.warn(
                f"{path}: {spoilt} lines are no records, their points are computed again",
                stacklevel=4,
            )

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.close()

    def close(self):
        """Let the file go; a second call does nothing."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def __contains__(self, key):
        """Whether the point needs no more work."""
        return self._records.get(key, {}).get("status") in FINISHED

    def __getitem__(self, key):
        return self._records[key]

    def add(self, record):
        """Keep a record, a dict of plain values with a ``key`` and a ``status``; NaN is null."""
        record = _plain(record)
        self._records[record["key"]] = record
        if self._file is not None:
            line = json.dumps(record, allow_nan=False).encode() + b"\n"
            written = self._file.write(line)
            if written != len(line):  # a full disk: the rest of the line would be a torn one
                raise OSError(f"journal: {written} of {len(line)} bytes written")


def blank_record(key, status, message):
    """Return the record of a point without numbers."""
    return {
        "key": key,
        "status": status,
        "message": message,
        "values": None,
        "ms": None,
        "frames": 0,
        "driver": {},
        "clock": "",
        "finished": "",
        "host": "",
        "machine": "",
        "process": 0,
    }


def _plain(value):
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
