"""What can be damaged: a reader, whole originals for it, and how bytes get to it."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from skinmap.errors import SkinError, SkinWarning

from .mutations import packed, spread


@dataclass(frozen=True)
class Target:
    """One reader.

    Attributes
    ----------
    name : str
        Of the target, and of its corpus.
    file : str
        What the damaged file is called; its suffix may decide how it is read.
    originals : function
        Whole files, small and real.
    read : function of Path
        Reads the file; for a message, whoever takes its bytes.
    covers : tuple of str
        Readers of the packages that it runs through, as `module.function`.
    beside : mapping of str to function
        Other files of the same folder.
    inside : bool
        Damage what the members of the zip hold, and pack them again.
    """

    name: str
    file: str
    originals: Callable[[], Sequence[bytes]]
    read: Callable[[Path], Any]
    covers: tuple[str, ...] = ()
    beside: Mapping[str, Callable[[], bytes]] = field(default_factory=dict)
    inside: bool = False

    def seeds(self) -> list[bytes]:
        """What damage starts from."""
        return [spread(one) if self.inside else one for one in self.originals()]

    def lay_out(self, folder: Path) -> None:
        """Write the files that stand beside the damaged one."""
        for name, make in self.beside.items():
            (folder / name).write_bytes(make())

    def try_one(self, data: bytes, folder: Path) -> bool:
        """Whether damaged bytes are read; False where they are refused with an error of ours.

        Anything else (another error, a warning that is not ours) is raised: a finding.
        """
        path = folder / self.file
        path.write_bytes(packed(data) if self.inside else data)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", SkinWarning)
            try:
                self.read(path)
            except SkinError:
                return False
        return True


def of_bytes(take: Callable[[bytes], Any]) -> Callable[[Path], Any]:
    """A reader of a file's content, for what comes as a message."""
    return lambda path: take(path.read_bytes())
