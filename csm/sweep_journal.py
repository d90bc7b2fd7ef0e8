"""The journal of a sweep: one line of JSON for every finished point, safe against a kill."""

import fcntl
import json
import math
import os
import uuid
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
    opened again, and lines that are no records are said in a warning and removed. One process may
    hold a journal at a time.

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
        self._file = _held(path)
        try:
            self._read(path)
        except BaseException:
            self.close()
            raise

    def _read(self, path):
        self._file.seek(0)
        content = self._file.read()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            os.ftruncate(self._file.fileno(), whole)
        lines, records = content[:whole].splitlines(keepends=True), []
        for line in lines:
            try:
                record = json.loads(line)
                self._records[record["key"]] = record
                records.append(line)
            except (ValueError, KeyError, TypeError):
                pass
        spoilt = len(lines) - len(records)
        if spoilt:
            self._rewrite(path, b"".join(records))
            warnings.warn(
                f"{path}: {spoilt} line(s) held no record and are removed; "
                "what they stood for is computed again",
                stacklevel=4,
            )

    def _rewrite(self, path, content):
        """Put other content in the file's place at once, and hold that."""
        beside = path.with_name(f".{uuid.uuid4().hex}.jsonl")
        fresh = _held(beside)
        try:
            written = fresh.write(content)
            if written != len(content):
                raise OSError(f"{path}: {written} of {len(content)} bytes written")
            os.fsync(fresh.fileno())
            os.replace(beside, path)
        except BaseException:
            fresh.close()
            beside.unlink(missing_ok=True)
            raise
        self._file.close()
        self._file = fresh

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


def _held(path):
    """Open a file to read and append, made if new, that no other process holds."""
    while True:
        file = open(path, "a+b", buffering=0)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Whoever held it may have put another in its place since it was opened here.
            if os.path.exists(path) and os.path.samestat(os.fstat(file.fileno()), os.stat(path)):
                return file
        except BlockingIOError:
            file.close()
            raise BlockingIOError(f"{path}: another sweep is writing to this folder") from None
        except BaseException:
            file.close()
            raise
        file.close()


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
