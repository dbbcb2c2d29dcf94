"""A server for other programs: grips, tools and loads on a body, by messages.

==================  ================================================================
`client`            one client: its requests and the replies to them, without a network
`control_requests`  those of a controller
`admission`         who may connect
`server`            WebSocket connections of such clients
==================  ================================================================
"""

from surrogate.serving.client import Client

__all__ = ["Client"]
