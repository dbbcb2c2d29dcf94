"""Cases: their configuration, and the body that is built from it."""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from datagen.cases.body import Body, make_body
    from datagen.cases.case import SHIPPED, Case, read_case

__all__ = ["SHIPPED", "Body", "Case", "make_body", "read_case"]
__getattr__, __dir__ = lazy_names(__name__)
