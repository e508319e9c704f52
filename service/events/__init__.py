"""Following a job's events as they are stored."""

from service.events.feed import EventFeed

__all__ = ["EventFeed"]
