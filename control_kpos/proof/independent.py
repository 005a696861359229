"""The independent checker, called from the package: its verdict on a file, archives included.

`load_certificate` asks it about files with numbers that are there for the checker alone, so that both refuse the same.
"""

from __future__ import annotations

import importlib
import json
from dataclasses import dataclass
from typing import Any

from ..errors import CertificateFileError, FalseClaimError
from .archive import expand
from .portable_cones import factors_in

# Characters of JSON that the checker takes on; it needs about a second for a megabyte.
_LONGEST = 2 * 10**8
# Sizes that a file may have besides one for each of its characters.
_SMALL = 20_000


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


def verdict(content: dict[str, Any]) -> Verdict:
    """Let `checker` decide, in rational arithmetic and from the proof in the file alone.

    Parameters
    ----------
    content : dict
        What `read_content` returned; arrays of archives are turned into text.
    """
    if content.get("status") == "UNDECIDED":
        return Verdict("", "It claims nothing that could be checked.")
    # not before it is needed: python -m control_kpos.checker warns where the package has loaded it
    checker: Any = importlib.import_module("..checker", __package__)
    try:
        expanded = expand(content)
        # as the checker's own command: sizes that no file of this length can need are refused before they take memory
        note = checker.verify(expanded, min(len(json.dumps(expanded)) + _SMALL, _LONGEST))
    except checker.Wrong as reason:
        return Verdict("WRONG", f"The independent checker disagrees: not proven: {reason}.")
    except (checker.Omitted, RecursionError, MemoryError) as reason:
        return Verdict("", f"Not checked independently of control_kpos: {reason}.")
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError) as reason:
        return Verdict("UNREADABLE", f"The independent checker cannot read it: {reason}.")
    confirmed = "The independent checker confirms it in rational arithmetic"
    return Verdict(str(content["status"]), f"{confirmed} ({note})." if note else f"{confirmed}.")


def require_agreement(content: dict[str, Any]) -> None:
    """Refuse a file in which a number that only the checker reads proves nothing.

    Those are `proof`, what shows that cones with more generators than dimensions are proper, and discs of eigenvalues.

    Raises
    ------
    CertificateFileError, FalseClaimError
        In the words of the checker.
    """
    found = verdict(content) if _is_for_the_checker(content) else None
    if found is not None and found.status in ("WRONG", "UNREADABLE"):
        raise (FalseClaimError if found.status == "WRONG" else CertificateFileError)(found.text)


def _is_for_the_checker(content: dict[str, Any]) -> bool:
    wide = any(len(part["rays"]) != len(part["rays"][0]) for part in factors_in(content))
    return wide or content["claim"] == "invariant-cone" or any(proofs_in(content))


def proofs_in(content: dict[str, Any]) -> list[dict[str, Any]]:
    """The proof of a file, and of the certificates in it."""
    parts = [part for x in content["data"].values() for part in (x.get("tuple", [x]) if isinstance(x, dict) else ())]
    inner = [part["certificate"] for part in parts if isinstance(part, dict) and "certificate" in part]
    return [content["proof"], *(proof for part in inner for proof in proofs_in(part))]
