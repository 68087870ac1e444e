"""The border of the socket: what a browser sends is checked before viser sees it.

viser closes a connection on a message that it cannot decode, and lets a client set any attribute of a control. Here a
message that is malformed, has a number that is not finite, or touches anything but the value of a control is dropped
and reported, and the connection lives on.
"""

import math
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

import viser

LARGEST_MESSAGE = 16 * 1024 * 1024
"""Largest message that is read, bytes: pictures of the page are the largest ones."""
LONGEST_TEXT = 100_000
"""Longest text in a control."""
POLICY_VIOLATION = 1008
"""Code of a web socket that is closed because it must not be open."""
SHOWN = 80
"""Characters of a reason that the page shows."""
DEEPEST = 8
"""Deepest nesting of a message."""
LENGTHS = {"wxyz": 4, "position": 3, "look_at": 3, "up_direction": 3}
"""Numbers in the vectors of a message."""
REFUSED_TYPES = frozenset({"ShareUrlRequest", "ShareUrlDisconnect"})
"""Messages that would make the server talk to a computer outside."""


def watch(server: viser.ViserServer, refused: Callable[[str], None]) -> None:
    """Check every message of every client of a server.

    Args:
        server: The server.
        refused: Called with the reason for each message that is dropped.
    """
    socket = server._websock_server

    def guard(client: Any) -> None:
        connection: Any = socket._live_connections.get(client.client_id)
        if connection is None:
            return
        receive = connection.recv

        if foreign(connection):
            refused("a page of another address wants to steer this explorer")

            async def closed(*args: Any, **options: Any) -> Any:
                await connection.close(POLICY_VIOLATION, "opened by a page of another address")
                return await receive(*args, **options)

            connection.recv = closed
            return

        async def checked(*args: Any, **options: Any) -> Any:
            while True:
                raw = await receive(*args, **options)
                reason = fault(raw)
                if reason is None:
                    return raw
                refused(reason[:SHOWN])

        connection.recv = checked

    socket.on_client_connect(guard)


def foreign(connection: Any) -> bool:
    """Whether a page that is not the explorer's own opened a connection: any page in a browser here could try."""
    headers = connection.request.headers
    origin = headers.get("Origin")
    return origin is not None and urlsplit(origin).netloc != headers.get("Host")


def fault(raw: Any) -> str | None:
    """What is wrong with a message, or None."""
    if not isinstance(raw, bytes) or len(raw) > LARGEST_MESSAGE:
        return f"a message that is no bytes, or more than {LARGEST_MESSAGE} of them"
    try:
        message = viser._messages.Message.deserialize(raw)
    except Exception as error:  # whatever the decoder raises
        return f"a message that cannot be decoded: {type(error).__name__}"
    kind = type(message).__name__
    if kind in REFUSED_TYPES:
        return f"{kind}: this explorer is not shared outside"
    updates = getattr(message, "updates", {})
    if not isinstance(updates, dict) or set(updates) - {"value"}:
        return f"{kind}: only the value of a control can be changed"
    return member_fault(message, kind)


def member_fault(message: Any, kind: str) -> str | None:
    """What is wrong with the members of a message, or None."""
    for name, value in vars(message).items():
        wrong = content_fault(value, 0)
        if wrong is not None:
            return f"{kind}: {name} {wrong}"
    for name, length in LENGTHS.items():
        value = getattr(message, name, None)
        if value is None:
            continue
        if not isinstance(value, tuple | list) or len(value) != length or not all(map(is_number, value)):
            return f"{kind}: {name} has not {length} numbers"
    return None


def content_fault(value: Any, depth: int) -> str | None:
    """What is wrong with a value inside a message, or None."""
    if depth > DEEPEST:
        return "is nested too deeply"
    if isinstance(value, float) and not math.isfinite(value):
        return f"is not finite ({value})"
    if isinstance(value, str) and len(value) > LONGEST_TEXT:
        return f"is a text of {len(value)} characters"
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list | tuple) else ()
    for one in inner:
        wrong = content_fault(one, depth + 1)
        if wrong is not None:
            return wrong
    return None


def is_number(value: Any) -> bool:
    """A number that is no bool."""
    return isinstance(value, int | float) and not isinstance(value, bool)
