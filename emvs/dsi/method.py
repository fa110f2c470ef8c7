"""What follows from a method's name, for all that have methods: maps, scores, pages."""

from __future__ import annotations

import re
from typing import NamedTuple

VOTES, OWN_UNIT = "votes", "own unit"  # what the values of a confidence are


class MethodName(NamedTuple):
    """The two parts of a method's name, such as `Alg1` and `H` or `cam0`; no slash, no variant."""

    family: str
    variant: str

    @classmethod
    def of(cls, name: str) -> MethodName:
        """Splits any name, whether a method has it or not."""
        family, _, variant = name.partition("/")
        return cls(family, variant)

    @property
    def camera(self) -> int | None:
        """The camera that the variant names, as `cam0` does."""
        match = re.fullmatch(r"cam(\d+)", self.variant)
        return int(match[1]) if match else None


class NamedMethod:
    """What follows from the name of any method, of the form Family/variant."""

    name: str

    @property
    def family(self) -> str:
        """The first part of its name."""
        return MethodName.of(self.name).family


def file_name(method: str) -> str:
    """Returns a method's name as files carry it."""
    return method.replace("/", "-")
