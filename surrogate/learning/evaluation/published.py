"""Published numbers of a network, to be shown beside the measured ones."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.configuration import Frozen, read_yaml, validate


class Published(Frozen):
    """Published numbers of a network of the same case; by default there are none.

    Attributes
    ----------
    heading : str
        Heading of their column in a report, such as ``paper``.
    source : str
        Sentence that says where they are published.
    example_displacement : float, optional
        Tip displacement in m of the sample that the publication shows; the evaluation shows the
        test sample whose tip displacement is nearest.
    numbers : dict of str to str
        Published numbers by the name of the report's row, such as ``training time: 131 min``.
    """

    heading: str = "published"
    source: str = ""
    example_displacement: float | None = None
    numbers: dict[str, str] = Field(default_factory=dict)


@checked_arguments
def read_published(path: str | Path) -> Published:
    """Read published numbers from a YAML file.

    Raises
    ------
    InputError
        If the file is missing or a key or value in it is wrong.
    """
    return validate(Published, read_yaml(Path(path)), str(path))
