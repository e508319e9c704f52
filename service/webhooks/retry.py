"""When a webhook is tried again, as a pure function."""

from __future__ import annotations

from datetime import timedelta

# Seconds after each failed try, near what Standard Webhooks recommends: over a day in all.
_DELAYS = (5, 30, 120, 600, 1800, 7200, 18000, 36000, 50400)


def next_delay(tries: int) -> timedelta | None:
    """How long to wait after ``tries`` failed tries; None when it is time to give up."""
    return timedelta(seconds=_DELAYS[tries - 1]) if tries <= len(_DELAYS) else None
