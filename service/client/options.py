"""How both clients are set up."""

from __future__ import annotations

import os
from typing import Any

import httpx

from service.client.errors import ClientError

DEFAULT_URL = "http://127.0.0.1:8000"
TIMEOUT = httpx.Timeout(60.0, connect=5.0)
# After so many tries in a row that brought nothing, a transfer is given up.
STALLS = 8
# A stream is quiet for at most a heartbeat's time.
STREAM_TIMEOUT = httpx.Timeout(30.0, connect=5.0)


def client_options(url: str | None, key: str | None) -> dict[str, Any]:
    """Arguments of the httpx client; VISCO_URL and VISCO_KEY stand in for what is not given.

    Raises ClientError for what is no address.
    """
    secret = key or os.environ.get("VISCO_KEY", "")
    address = url or os.environ.get("VISCO_URL") or DEFAULT_URL
    if not address.startswith(("http://", "https://")):
        raise ClientError(
            f"{address} is no address of a service; give one that begins with http:// or https://."
        )
    return {
        "base_url": address,
        "headers": {"Authorization": f"Bearer {secret}"} if secret else {},
        "timeout": TIMEOUT,
    }
