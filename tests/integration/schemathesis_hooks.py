"""Read by schemathesis: how pieces of an upload are sent."""

import schemathesis


@schemathesis.serializer("application/offset+octet-stream")
def piece(context: object, value: object) -> bytes:
    return value if isinstance(value, bytes) else str(value).encode()
