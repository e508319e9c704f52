"""How many calls a minute: counted in the broker, so that all API processes count together."""

from __future__ import annotations

import logging
import time

from service.errors import ServiceError
from service.jobs.queues import Bell

log = logging.getLogger(__name__)
_WINDOW_SECONDS = 60


class RateLimiter:
    """A sliding minute made of two fixed ones. Without the broker every call is let through."""

    def __init__(self, bell: Bell, per_minute: int) -> None:
        self.bell = bell
        self.per_minute = per_minute
        self._away = False

    def check(self, caller: str) -> None:
        """Count one call. Raises ServiceError ``rate_limited`` with the seconds to wait."""
        if not self.per_minute:
            return
        now = time.time()
        window, passed = divmod(now, _WINDOW_SECONDS)
        try:
            current, previous = self._count(caller, int(window))
        except Exception as error:  # noqa: BLE001  a broker that is away must not stop the API
            if not self._away:
                log.warning("Calls are not counted while the broker is away: %s", error)
            self._away = True
            return
        self._away = False
        recent = current + previous * (1 - passed / _WINDOW_SECONDS)
        if recent > self.per_minute:
            wait = max(1, round(_WINDOW_SECONDS - passed))
            raise ServiceError(
                "rate_limited",
                f"Send at most {self.per_minute} calls a minute; wait {wait} s.",
                headers={"Retry-After": str(wait)},
            )

    def _count(self, caller: str, window: int) -> tuple[int, int]:
        pipe = self.bell.redis.pipeline(transaction=False)
        pipe.incr(f"visco:calls:{caller}:{window}")
        pipe.expire(f"visco:calls:{caller}:{window}", 2 * _WINDOW_SECONDS)
        pipe.get(f"visco:calls:{caller}:{window - 1}")
        current, _, previous = pipe.execute()
        return int(current), int(previous or 0)
