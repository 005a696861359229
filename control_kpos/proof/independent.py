"""The independent checker, called from the package: its verdict on a file, archives included."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike

from .. import checker
from .files import read_content

# Characters of JSON that the checker takes on; it needs about a second for a megabyte.
_LONGEST = 2 * 10**8


@dataclass(frozen=True)
class Verdict:
    """What the independent checker says.

    Attributes
    ----------
    status : str
        "PROVED" or "REFUTED", "WRONG" for a file that does not prove what it says, "UNREADABLE" for one that is not
        written as the format says, "" where the file has nothing that can be checked without the package.
    text : str
        In words.
    """

    status: str
    text: str


def verdict(path: str | PathLike[str]) -> Verdict:
    """Let `checker` decide, in rational arithmetic and from the proof in the file alone.

    Raises
    ------
    CertificateFileError
        The file is not a certificate.
    """
    content = read_content(path, as_text=True)
    try:
        note = checker.verify(content, _LONGEST)
    except checker.Wrong as reason:
        return Verdict("WRONG", f"The independent checker disagrees: not proven: {reason}.")
    except (checker.Omitted, RecursionError, MemoryError) as reason:
        return Verdict("", f"Not checked independently of control_kpos: {reason}.")
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError) as reason:
        return Verdict("UNREADABLE", f"The independent checker cannot read it: {reason}.")
    confirmed = "The independent checker confirms it in rational arithmetic"
    return Verdict(str(content["status"]), f"{confirmed} ({note})." if note else f"{confirmed}.")
