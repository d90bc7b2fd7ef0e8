"""Plain values as text that reads back the same: JSON and TOML.

Both say floats by the shortest digits that give the same bits. TOML is read by the standard
library, which does not write it; what is written here is what this package has to say: text,
numbers, truth values, lists of them, tables, and lists of tables.
"""

import difflib
import json
import math
import re
import tomllib
from collections.abc import Mapping
from contextlib import contextmanager
from pathlib import Path

__all__ = [
    "Recorded",
    "check_keys",
    "named",
    "read_file",
    "read_json",
    "read_toml",
    "write_file",
    "write_json",
    "write_toml",
]

SUFFIXES = (".json", ".toml")
MARK = "\ufeff"  # of byte order, which some editors begin a text with
BARE = re.compile(r"[A-Za-z0-9_-]+")


def write_json(values):
    """JSON of plain values.

    Parameters
    ----------
    values : dict
        Text, numbers, truth values, None, lists and dicts of them. JSON has no number that is not
        finite: those become the texts "inf", "-inf" and "nan", which `float` reads.

    Returns
    -------
    text : str
    """
    return json.dumps(_finite(values), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def read_json(text):
    """Read an object of JSON.

    Parameters
    ----------
    text : str

    Returns
    -------
    values : dict

    Raises
    ------
    TypeError
        If `text` is no str.
    ValueError
        If it is no JSON, no object, or has a key twice or a number that is not finite.
    """
    try:
        values = json.loads(
            _text(text).removeprefix(MARK), object_pairs_hook=_once, parse_constant=_no_constant
        )
    except json.JSONDecodeError as error:
        raise ValueError(f"no JSON: {error}") from None
    except RecursionError:
        raise ValueError("no JSON of ours: nested too deep") from None
    if not isinstance(values, dict):
        raise ValueError(f"must be an object in JSON (got {type(values).__name__})")
    return values


def write_toml(values):
    """TOML of plain values.

    Parameters
    ----------
    values : dict
        As for `write_json`; a key of None is left out, as TOML has none. Keys with plain values
        come before tables, as TOML wants it.

    Returns
    -------
    text : str
    """
    return "\n".join(_table(values, ())).lstrip("\n") + "\n"


def read_toml(text):
    """Read TOML.

    Parameters
    ----------
    text : str

    Returns
    -------
    values : dict

    Raises
    ------
    TypeError
        If `text` is no str.
    ValueError
        If it is no TOML.
    """
    try:
        return tomllib.loads(_text(text).removeprefix(MARK))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"no TOML: {error}") from None
    except RecursionError:
        raise ValueError("no TOML of ours: nested too deep") from None


def read_file(path):
    """Read a file of either kind, by its suffix.

    Parameters
    ----------
    path : path_like
        ``.json`` or ``.toml``.

    Returns
    -------
    values : dict

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it has another suffix or does not read; the text names the file.
    """
    path = _known(path)
    read = read_json if path.suffix.lower() == ".json" else read_toml
    content = path.read_bytes()
    with named(path):
        try:
            text = content.decode("utf-8")
        except UnicodeDecodeError as error:
            raise ValueError(f"is no text ({error})") from None
        return read(text)


class Recorded:
    """What has `to_dict` and `from_dict`, as text and in files: JSON and TOML, bit for bit."""

    __slots__ = ()

    def to_json(self):
        """Everything that `to_dict` gives, as JSON, from which `from_json` makes an equal one.

        Returns
        -------
        text : str
        """
        return write_json(self.to_dict())

    @classmethod
    def from_json(cls, text):
        """Make one of a text of JSON.

        Parameters
        ----------
        text : str

        Returns
        -------
        made
            `from_dict` of its object.

        Raises
        ------
        TypeError, ValueError
            If it is no JSON, or `from_dict` refuses; the text names key, value and what is allowed.
        """
        return cls.from_dict(read_json(text))

    def to_toml(self):
        """Everything that `to_dict` gives, as TOML, from which `from_toml` makes an equal one.

        Returns
        -------
        text : str
        """
        return write_toml(self.to_dict())

    @classmethod
    def from_toml(cls, text):
        """Make one of a text of TOML.

        Parameters
        ----------
        text : str

        Returns
        -------
        made
            `from_dict` of its keys.

        Raises
        ------
        TypeError, ValueError
            If it is no TOML, or `from_dict` refuses; the text names key, value and what is allowed.
        """
        return cls.from_dict(read_toml(text))

    def save(self, path):
        """Write it to a file.

        Parameters
        ----------
        path : path_like
            ``.json`` or ``.toml``.

        Raises
        ------
        OSError, ValueError
            If it cannot be written, or has another suffix.
        """
        text = self.to_json() if _known(path).suffix.lower() == ".json" else self.to_toml()
        write_file(path, text)

    @classmethod
    def load(cls, path):
        """Make one of a file that `save` wrote, or a person.

        Parameters
        ----------
        path : path_like
            ``.json`` or ``.toml``.

        Returns
        -------
        made
            `from_dict` of what it holds.

        Raises
        ------
        OSError, TypeError, ValueError
            If it cannot be read, or `from_dict` refuses; the text names the file, too.
        """
        values = read_file(path)
        with named(path):
            return cls.from_dict(values)


def write_file(path, text):
    """Write a text as UTF-8 with line feeds.

    Parameters
    ----------
    path : path_like
    text : str

    Raises
    ------
    OSError
        If the folder is not there or may not be written.
    """
    Path(path).write_text(text, encoding="utf-8", newline="\n")


@contextmanager
def named(where):
    """Let refusals begin with where they come from: a file, or a part of one."""
    try:
        yield
    except TypeError as error:
        raise TypeError(f"{where}: {error}") from None
    except (ValueError, OverflowError) as error:  # of text or numbers that are none of ours, too
        raise ValueError(f"{where}: {error}") from None


def check_keys(what, values, known, required=()):
    """Refuse what is no table, unknown keys and missing ones.

    Parameters
    ----------
    what : str
        For the text of the refusal.
    values : dict
    known, required : sequence of str

    Raises
    ------
    TypeError, ValueError
        Naming the key, and what is allowed.
    """
    if not isinstance(values, Mapping):
        raise TypeError(f"{what} must be a table of {', '.join(known)} (got {values!r})")
    for key in values:
        if key not in known:
            close = difflib.get_close_matches(str(key), list(known), n=1)
            hint = f"; did you mean {close[0]!r}?" if close else ""
            raise ValueError(f"{what} knows no {key!r}{hint}; there are {', '.join(known)}")
    for key in required:
        if key not in values:
            raise ValueError(f"{what} needs {key!r}")


def _known(path):
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"a file must end in {' or '.join(SUFFIXES)} (got {str(path)!r})")
    return path


def _text(text):
    if not isinstance(text, str):
        raise TypeError(f"text must be a str (got {type(text).__name__})")
    return text


def _once(pairs):
    values = dict(pairs)
    if len(values) < len(pairs):
        seen = [key for key, _ in pairs]
        twice = next(key for key in seen if seen.count(key) > 1)
        raise ValueError(f"{twice!r} is there twice")
    return values


def _no_constant(name):
    raise ValueError(f"no number of JSON: {name}")


def _finite(value):
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return repr(value) if isinstance(value, float) and not math.isfinite(value) else value


def _table(values, where):
    """Lines of a table and of the tables in it."""
    lines, tables = [], []
    for key, value in values.items():
        if value is None:
            continue
        if isinstance(value, dict) or _is_tables(value):
            tables.append((key, value))
        else:
            lines.append(f"{_key(key)} = {_value(value)}")
    for key, value in tables:
        name = ".".join(map(_key, (*where, key)))
        for one in [value] if isinstance(value, dict) else value:
            lines += ["", f"[{name}]" if isinstance(value, dict) else f"[[{name}]]"]
            lines += _table(one, (*where, key))
    return lines


def _is_tables(value):
    if not isinstance(value, list | tuple) or not value:
        return False
    return all(isinstance(item, dict) for item in value)


def _key(key):
    return key if BARE.fullmatch(key) else _string(key)


def _value(value):
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _string(value)
    if isinstance(value, int):
        return repr(value)
    if isinstance(value, float):
        return repr(value)  # inf, -inf and nan are TOML's words, too
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    raise TypeError(f"TOML has no {type(value).__name__} (got {value!r})")


def _string(text):
    # JSON's escapes are TOML's; TOML wants the delete character escaped, too
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
