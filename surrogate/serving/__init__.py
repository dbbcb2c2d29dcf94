"""A server for other programs: grips, tools and loads on a body, by messages.

==================  ========================================================="""

from surrogate.serving.client import Client

__all__ = ["Client"]
